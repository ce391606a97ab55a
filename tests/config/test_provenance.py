"""Seeds, hashes and stamps."""

import pytest

from dldsim.config.provenance import STAMP, check_stamp, derive_seed, settings_hash
from dldsim.errors import DldsimError


def test_seeds_differ_by_name_and_repeat():
    seeds = {derive_seed(seed, name) for seed in range(4) for name in "abc"}
    assert len(seeds) == 12
    assert derive_seed(1, "a") == derive_seed(1, "a") < 2**31


def test_settings_hash_ignores_order_only():
    assert settings_hash({"a": 1, "b": 2}) == settings_hash({"b": 2, "a": 1})
    assert settings_hash({"a": 1}) != settings_hash({"a": 2})


def test_stamp_of_other_physics_is_refused(tmp_path):
    check_stamp(tmp_path)
    stamp = tmp_path / STAMP
    stamp.write_text('{"dldsim_version": "0.0.1", "physics_version": -1}')
    with pytest.raises(DldsimError, match="--forceall"):
        check_stamp(tmp_path)
    stamp.write_text("{")
    with pytest.raises(DldsimError, match="delete .* alone, and all results are used"):
        check_stamp(tmp_path)
