"""What a request asks of devices in the package's terms, and what leaves them as an answer."""

from collections.abc import Sequence
from typing import Any

from dldsim.app import design_answers
from dldsim.app.asked import Asked, ask
from dldsim.app.outcome_answers import Design, make_outcomes
from dldsim.app.web.api import outcome_specs
from dldsim.app.web.api.data import Source, table_rows
from dldsim.config.design_sections import CellTypes, Device
from dldsim.config.explain import validate
from dldsim.design.device_outcome import DeviceOutcome, tables_of, warnings_of
from dldsim.design.finished_campaign import Campaign
from dldsim.design.populations import doubt, rows_of
from dldsim.errors import DldsimError

NAMES = ("array", "second array")
"""Of the devices of a cascade."""


def asked_of(spec: outcome_specs.CellsInDevice, known: Campaign) -> tuple[Asked, list[Design]]:
    """Both cell types of a request, and its devices.

    Raises DldsimError as `resolve`, `ask` and the sections do.
    """
    request = spec.request
    asked = ask(request, design_answers.resolve_by(known, request), known.tables, spec.measured)
    designs = [
        Design(
            name,
            design_answers.geometry_of(device.geometry),
            _device(known.chip.device, device.device, place),
            {},
        )
        for name, place, device in zip(NAMES, ("", "then."), spec.devices, strict=False)
    ]
    return asked, designs


def _device(own: Device, given: dict[str, Any], place: str) -> Device:
    """The service's device with what a request gives at ``place``. Raises DldsimError that names
    the fields."""
    try:
        return validate(Device, own.model_dump() | given)
    except DldsimError as error:
        text = "; ".join(fault.allowed for fault in error.faults)
        which = "second device" if place else "device"
        raise DldsimError(
            f"The {which}: {text}.", key=[place + key for key in error.keys]
        ) from error


def outcomes_of(
    spec: outcome_specs.CellsInDevice, source: Source
) -> tuple[Asked, list[Design], list[DeviceOutcome]]:
    """The same, and what comes out. Raises DldsimError as `make_outcomes` does, too."""
    asked, designs = asked_of(spec, source.known)
    outlet = getattr(spec, "from_outlet", None)
    found = make_outcomes(asked, designs, source.known, spec.seed, from_outlet=outlet)
    return asked, designs, found


def answer_of(
    asked: Asked, designs: Sequence[Design], found: Sequence[DeviceOutcome], source: Source
) -> dict[str, Any]:
    """Fields of an `OutcomeAnswer`."""
    request = asked.request.model_dump(include=set(CellTypes.model_fields) | {"tolerance_um"})
    devices = [design.device.model_dump() for design in designs]
    return at_outlets(found, [*asked.notes, *warnings_of(found)]) | {
        "request": request,
        "device": devices[0],
        "then": devices[1] if len(devices) == 2 else None,
        "populations": rows_of(asked.populations, asked.request.name),
        "doubt": doubt(asked.populations),
        "warnings": source.provenance.warnings,
        "provenance": source.provenance,
    }


def at_outlets(devices: Sequence[DeviceOutcome], notes: Sequence[str]) -> dict[str, Any]:
    """What leaves some devices, as an answer."""
    tables = tables_of(devices)
    return {kind: table_rows(kind, table) for kind, table in tables.items()} | {
        "notes": list(notes)
    }
