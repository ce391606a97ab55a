"""JSON schema of config.yaml, for editors."""

from pathlib import Path

from dldsim.config.configuration import Config


def json_schema() -> dict:
    """JSON schema of config.yaml, for editors: shared sections, `preset` and `presets`."""
    schema = Config.model_json_schema()
    for definition in schema["$defs"].values():  # a preset or a shared section may be partial
        definition.pop("required", None)
    schema.pop("required", None)
    sections = {key: value for key, value in schema["properties"].items() if key != "preset"}
    for key in (
        "stiffness_sets",
        "constriction_groups",
        "assays",
    ):  # a preset takes one out with null
        entry = {"anyOf": [*sections[key]["patternProperties"].values(), {"type": "null"}]}
        sections[key] = {"type": "object", "additionalProperties": entry}
    schema["properties"]["presets"] = {
        "description": "named overlays of the sections above",
        "type": "object",
        "additionalProperties": {
            "type": "object",
            "properties": sections,
            "additionalProperties": False,
        },
    }
    return schema


def main() -> None:
    """Write the JSON schema to the file named on the command line."""
    import json
    import sys

    text = json.dumps(json_schema(), indent=2, ensure_ascii=False) + "\n"
    Path(sys.argv[1]).write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
