"""Nothing is left of a file that could not be written, and the reason is told with a remedy."""

import errno
import os

import pytest

from dldsim.config import campaign
from dldsim.config.provenance import write_stamp
from dldsim.errors import DldsimError
from dldsim.files import atomic_path, why_not_read, why_not_written
from dldsim.report import campaign_page
from dldsim.tables import parquet


def test_a_file_is_there_whole_or_not_at_all(tmp_path):
    path = tmp_path / "new" / "a.txt"
    with atomic_path(path) as part:
        part.write_text("whole")
        assert not path.exists()
    assert path.read_text() == "whole"
    with pytest.raises(ValueError), atomic_path(path) as part:
        part.write_text("half")
        raise ValueError
    assert [*path.parent.iterdir()] == [path] and path.read_text() == "whole"


@pytest.mark.parametrize(
    "write",
    [
        lambda folder: campaign.record_crash(folder, "a", "no memory"),
        lambda folder: write_stamp(folder),
        lambda folder: campaign.check_writable(folder),
    ],
)
def test_a_full_disk_leaves_no_part_behind(write, tmp_path, monkeypatch):
    def full(number):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), "results/a")

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises((OSError, DldsimError), match="No space left"):
        write(tmp_path)
    assert not [*tmp_path.iterdir()]


def test_a_closed_folder_is_told_with_the_remedy(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(DldsimError, match="cannot be written: .*Not a directory"):
        campaign.check_writable(tmp_path / "file" / "results")
    campaign.check_writable(tmp_path / "results")
    assert not [*(tmp_path / "results").iterdir()]


@pytest.mark.parametrize(
    ("number", "parts"),
    [
        (
            errno.ENOSPC,
            ["No space left", "results/a", "Make room and start the same command again"],
        ),
        (errno.EDQUOT, ["quota", "Make room"]),
        (errno.EROFS, ["Read-only", "--directory FOLDER"]),
        (errno.EACCES, ["Permission denied", "chmod", "--directory FOLDER"]),
    ],
)
def test_what_keeps_a_file_from_being_written_has_a_remedy(number, parts):
    said = why_not_written(OSError(number, os.strerror(number), "results/a"))
    assert all(part in said for part in parts)


def test_other_errors_are_none_of_the_disk():
    assert why_not_written(FileNotFoundError(errno.ENOENT, "gone")) is None


def test_a_good_file_out_of_reach_is_not_called_damaged(tmp_path, monkeypatch):
    def closed(path):
        raise PermissionError(errno.EACCES, "Permission denied")

    monkeypatch.setattr(parquet.pq, "ParquetFile", closed)
    with pytest.raises(DldsimError, match="cannot be read: Permission denied") as refusal:
        parquet.read_columns("runs", tmp_path / "runs.parquet")
    assert "Delete" not in str(refusal.value)
    assert why_not_read(tmp_path, EOFError()) is None


def test_a_report_that_cannot_be_written_is_told_in_one_sentence(tmp_path, monkeypatch):
    def full(*arguments):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), "results/report.html")

    monkeypatch.setattr(campaign_page, "make_report", full)
    assert campaign_page.renew_report(tmp_path, {}).startswith("No report: No space left")
