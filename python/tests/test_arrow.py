"""Whatever reads Arrow takes estimates as a table."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import polars
import pyarrow
import pytest

import tactile_pose_fusion as tpf

pytestmark = pytest.mark.filterwarnings("ignore::tactile_pose_fusion.TactilePoseFusionWarning")


@pytest.fixture(scope="module")
def estimates(bag: Path, params: Path) -> tpf.Estimates:
    return tpf.replay(bag, params)


def test_pyarrow_reads_the_same_memory(estimates: tpf.Estimates) -> None:
    index = estimates["index"]
    for table in [pyarrow.table(estimates), pyarrow.table(index)]:
        assert table.num_rows == len(index)
        assert table.schema.field("stamp").type == pyarrow.timestamp("ns", tz="UTC")
        force = table["force_n"].chunk(0)
        assert force.null_count == np.isnan(index.force_n).sum() > 0
        assert force.buffers()[1].address == index.force_n.__array_interface__["data"][0]
        assert table["contact"].to_pylist() == index.contact.tolist()
        assert set(table["region"].to_pylist()) == {"index"}
        assert table["flags"].to_numpy().tolist() == index.flags.tolist()
    assert pyarrow.record_batch(index).num_rows == len(index)


def test_polars_takes_them(estimates: tpf.Estimates) -> None:
    index = estimates["index"]
    frame = polars.DataFrame(estimates)
    assert frame.height == len(index) and frame["force_n"].null_count() == np.isnan(index.force_n).sum()
    in_contact = frame.filter(polars.col("contact")).select(polars.col("force_n").mean()).item()
    assert in_contact == pytest.approx(np.nanmean(index.force_n[index.contact]))
    assert frame["stamp"].dt.timestamp("ns").to_list() == index.stamp_ns.tolist()


def test_estimates_of_no_frame_are_an_empty_table(params: Path) -> None:
    nothing = tpf.Glove.load(params).core().finish()
    assert len(nothing["index"]) == 0 and nothing["index"].force_n.shape == (0,)
    assert pyarrow.table(nothing).num_rows == 0 and polars.DataFrame(nothing).height == 0
