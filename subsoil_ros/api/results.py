"""series.csv and summary.json of a run that has ended, made from its bag."""

from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext
from pathlib import Path
from typing import Any

from ..analysis.series import read_series, write_series_csv
from ..analysis.summarize import summarize, summarize_unrecorded
from ..analysis.summary import UnrecordedSummary
from ..errors import RecordingError, SubsoilError
from ..limits.stable_steps import Timing
from ..loading.loader import ResolvedScene
from ..recording.joined import mend_earlier
from ..recording.recovery import recover

Reading = Callable[[Timing], AbstractContextManager[Callable[[int], None]]]
"""Shows that a bag is being read; yields a callback that takes the time [ns] of each message."""

Working = Callable[[str], AbstractContextManager[object]]
"""Shows that work of this name is in progress."""


def write_results(
    resolved: ResolvedScene,
    out: Path,
    run_info: dict[str, Any],
    failure: SubsoilError | None = None,
    *,
    reading: Reading = lambda timing: nullcontext(lambda time_ns: None),
    working: Working = nullcontext,
) -> UnrecordedSummary | None:
    """Write series.csv and summary.json into the folder `out` of a run, from its bag.

    run_info: facts that are not in the bag, fields of summary.RunFacts.

    Returns:
        The summary, of a recorded run a summary.Summary; None if the run failed before anything was recorded.

    Raises:
        RecordingError: the bag of a run that did not fail cannot be read, or the results not be written.
    """
    bag = out / "bag"
    if failure is not None:
        run_info = run_info | {"failure": str(failure)}
    try:
        if not resolved.scene.record.bag and not bag.is_dir():
            unrecorded = summarize_unrecorded(resolved, run_info)
            unrecorded.write(out / "summary.json")
            return unrecorded
        if failure is not None:
            with working("looking after the bag"):
                recover(bag)  # its writer may have been killed; a whole bag is left as it is
        mend_earlier(out)
        with reading(resolved.timing) as on_time:
            series = read_series(bag, resolved.scene, on_time)
        write_series_csv(series, out / "series.csv")
        with working("reading the clouds"):
            summary = summarize(bag, resolved, run_info, series)
        summary.write(out / "summary.json")
        return summary
    except SubsoilError:
        if failure is None:
            raise
    except OSError as error:
        if failure is None:
            raise RecordingError(f"{out}: the results cannot be written ({error.strerror})") from error
    return None
