"""Tells as JSON what pyarrow reads in a Parquet file: its types, its notes and its rows.

usage: read_parquet.py TABLE.parquet [COLUMN..]
"""

import json
import sys

import pyarrow as pa
import pyarrow.parquet as pq

table = pq.read_table(sys.argv[1], columns=sys.argv[2:] or None)
stamps = [field.name for field in table.schema if pa.types.is_timestamp(field.type)]
types = {field.name: str(field.type) for field in table.schema}
for name in stamps:
    table = table.set_column(table.schema.get_field_index(name), name, table[name].cast(pa.int64()))
notes = {key.decode(): value.decode() for key, value in (pq.read_metadata(sys.argv[1]).metadata or {}).items()}
json.dump({"types": types, "notes": notes, "columns": table.to_pydict()}, sys.stdout)
