"""Runs the cases of validation/extremes.md, the long ones too, and prints the table of results.

    python -m validation [KEY ...] [--fast] [--json FILE]

KEY: only these, for instance S14. The table is Markdown; the JSON has the same and the times.
"""

import argparse
import json
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

from subsoil_ros.errors import SubsoilError

from . import (
    beds,
    coupling,
    laws,
    mechanism,
    nasty_machines,
    plastic_and_bonded,
    steps,
    tools,
    windows,
)
from .cases import Case, WrongEndError

PARTS = (
    steps,
    laws,
    tools,
    beds,
    plastic_and_bonded,
    windows,
    mechanism,
    nasty_machines,
    coupling,
)


def measure(case: Case) -> dict[str, Any]:
    """One row of the table; a case that ends otherwise is a row too."""
    start = time.process_time()
    with tempfile.TemporaryDirectory() as folder:
        try:
            outcome = case.run(Path(folder))
            row = {"ending": outcome.ending, "found": outcome.found, "as_expected": True}
        except (WrongEndError, SubsoilError) as error:
            row = {"ending": "WRONG", "found": str(error), "as_expected": False}
    return {
        "case": case.key, "what": case.title, "expected": " or ".join(case.endings), **row,
        "cpu_s": round(time.process_time() - start, 1),
    }  # fmt: skip


def markdown(rows: list[dict[str, Any]]) -> str:
    """The table."""
    lines = ["| case | what | expected | ended | found |", "|---|---|---|---|---|"]
    for row in rows:
        found = " ".join(row["found"].replace("|", "/").split())
        lines.append(f"| {row['case']} | {row['what']} | {row['expected']} | {row['ending']} | {found} |")
    return "\n".join(lines)


def main() -> int:
    """Runs the cases. Returns 1 if one ended otherwise than it must."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("keys", nargs="*", metavar="KEY")
    parser.add_argument("--fast", action="store_true", help="without the long cases")
    parser.add_argument("--json", type=Path, metavar="FILE")
    args = parser.parse_args()
    rows = []
    for case in (case for part in PARTS for case in part.CASES):
        if (args.keys and case.key not in args.keys) or (args.fast and case.long):
            continue
        rows.append(measure(case))
        print(
            f"{case.key} {rows[-1]['ending']} {rows[-1]['cpu_s']} s {rows[-1]['found']}",
            file=sys.stderr,
            flush=True,
        )
    print(markdown(rows))
    if args.json is not None:
        args.json.write_text(json.dumps(rows, indent=1) + "\n", encoding="utf-8")
    return int(not all(row["as_expected"] for row in rows))


if __name__ == "__main__":
    raise SystemExit(main())
