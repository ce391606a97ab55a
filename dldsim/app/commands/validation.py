"""Reference cases: `validate`."""

import argparse
from collections.abc import Iterable, Mapping, Sequence

from dldsim.app.commands.options import add_command, place
from dldsim.app.commands.output import Display, check_writable, in_columns


def run_validation(args: argparse.Namespace) -> tuple[dict, Iterable[str], int]:
    """Validation cases; the exit code is 1 if one of them fails."""
    from dldsim.evidence.validation import CASES, check_cases, failures, run_case, verdicts

    names = check_cases(args.cases)
    if args.list:
        cases = {name: CASES[name]._asdict() for name in names if name in CASES}
        width = max(map(len, cases))
        lines = [f"{name:{width}}  {c['group']:8}  {c['title']}" for name, c in cases.items()]
        return cases, lines, 0
    if args.out:
        check_writable(args.out, "--out")
    rows = []
    with Display() as progress:
        for name in names:
            progress(f"{name}: {CASES[name].title}" if name in CASES else f"{name}: unknown")
            rows += run_case(name, progress)
    summary = {"cases": verdicts(rows), "rows": rows}
    if args.out:
        from dldsim.config.provenance import provenance
        from dldsim.tables.parquet import write_csv, write_table

        write_table("validation", rows, args.out, provenance({"cases": names}))
        summary["files"] = [str(args.out), str(write_csv("validation", args.out))]
    failing = failures(rows)
    lines = [*_comparison_lines(rows), *_verdict_lines(summary["cases"])]
    lines += [f"fails: {sentence}" for sentence in failing]
    lines += [f"note: {note}" for note in dict.fromkeys(r["note"] for r in rows) if note]
    return summary, lines, int(bool(failing))


def _comparison_lines(rows: Sequence[Mapping]) -> list[str]:
    """A table of the comparisons of each case."""
    lines = []
    for name in dict.fromkeys(row["case"] for row in rows):
        of_case = [row for row in rows if row["case"] == name]

        def cells(key: str, form: str, of_case=of_case) -> list[str]:
            return ["" if row[key] is None else format(row[key], form) for row in of_case]

        def heading(key: str, of_case=of_case) -> str:
            """What the column counts, where that is the same in all rows."""
            meanings = {row[f"{key}_of"] for row in of_case} - {""}
            return meanings.pop() if len(meanings) == 1 else key

        lines += [f"{name} (reference: {of_case[0]['source']})"]
        lines += in_columns(
            {
                "quantity": cells("quantity", ""),
                "variant": cells("variant", ""),
                heading("parameter"): cells("parameter", "g"),
                heading("resolution"): cells("resolution", "g"),
                "reference": cells("reference", ".6g"),
                "value": cells("value", ".6g"),
                "unit": cells("unit", ""),
                "error": cells("relative_error", "+.2e"),
                "allowed": cells("mark", ".1e"),
                "order": cells("observed_order", ".1f"),
                "result": [
                    {True: "passes", False: "FAILS", None: "shown"}[row["passed"]]
                    for row in of_case
                ],
            }
        ) + [""]
    return lines


def _verdict_lines(cases: Sequence[Mapping]) -> list[str]:
    return [
        *in_columns(
            {
                "case": [case["case"] for case in cases],
                "result": ["passes" if case["failed"] == 0 else "FAILS" for case in cases],
                "within marks": [
                    f"{case['marked'] - case['failed']} of {case['marked']}" for case in cases
                ],
                "largest error / allowed": [
                    "" if case["error_over_mark"] is None else f"{case['error_over_mark']:.2g}"
                    for case in cases
                ],
                "time [s]": [f"{case['wall_time_s']:.1f}" for case in cases],
            }
        ),
        "",
    ]


def add_validate(commands) -> None:
    """The command `validate`."""
    parser = add_command(
        commands,
        "validate",
        run_validation,
        "cases beside reference values",
        "validate square-arrays membrane-forces --out validation.parquet",
    )
    parser.add_argument("cases", nargs="*", metavar="CASE", help="names of cases; default: all")
    parser.add_argument("--list", action="store_true", help="list the cases and run none")
    parser.add_argument(
        "--out",
        type=place,
        metavar="FILE.parquet",
        help="write the comparisons there, with a CSV twin",
    )
