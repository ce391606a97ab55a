"""Every table has a home: the rule that makes it writes the file where it is looked for."""

import re
from pathlib import Path

import pytest

from dldsim.tables.registry import TABLES

RULES = Path(__file__).parents[2] / "workflow" / "rules"


@pytest.fixture(scope="module")
def outputs():
    """Text of the outputs of each rule."""
    found = {}
    for path in RULES.glob("*.smk"):
        _, *blocks = re.split(r"^rule (\w+):", path.read_text(encoding="utf-8"), flags=re.M)
        for name, block in zip(blocks[::2], blocks[1::2], strict=True):
            _, _, after = block.partition("output:")
            found[name] = re.split(r"^    \w+:", after, flags=re.M)[0]
    return found


def test_rules_make_the_files_of_the_tables(outputs):
    for kind, (_, file, rule) in TABLES.items():
        assert (file is None) == (rule is None)
        assert file is None or f'{{RESULTS}}/{file}"' in outputs[rule], kind


def test_every_table_that_a_rule_gathers_is_known(outputs):
    written = {
        name
        for text in outputs.values()
        for name in re.findall(r"\{RESULTS\}/((?:reference/|survey/)?\w+)\.parquet", text)
    }
    other = {"outcomes_verified", "reference/sigma_num_check", "reference/domain_outcomes"}
    other |= {"reference/campaign_outcomes", "survey/outcomes", "survey/runs", "survey/flows"}
    assert written - other == {t.file.removesuffix(".parquet") for t in TABLES.values() if t.file}
