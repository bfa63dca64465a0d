"""Prints for each file that was cut off in mid-write how many messages the `mcap` package gets out of it.

usage: read_cut.py FILE.mcap...
"""

import sys

from mcap.exceptions import McapError
from mcap.records import Message
from mcap.stream_reader import StreamReader

for path in sys.argv[1:]:
    n_messages = 0
    with open(path, "rb") as file:
        try:
            for record in StreamReader(file).records:
                n_messages += isinstance(record, Message)
        except (McapError, EOFError):
            pass
    print(n_messages)
