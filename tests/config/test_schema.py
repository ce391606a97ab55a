"""The JSON schema is that of the sections."""

import json
from pathlib import Path

from dldsim.config.schema import json_schema

ROOT = Path(__file__).parents[2]


def test_json_schema_is_up_to_date():
    stored = (ROOT / "workflow/schemas/config.schema.json").read_text(encoding="utf-8")
    assert json.loads(stored) == json_schema(), "repair with: make schema"
