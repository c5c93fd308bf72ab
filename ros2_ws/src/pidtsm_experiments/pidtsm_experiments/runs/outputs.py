"""What is computed and drawn from the recording of a run, in its result folder."""

from pathlib import Path
from typing import Any

from pidtsm_core.recording import Recording
from pidtsm_core.recording.summary import write_metrics
from pidtsm_experiments.runs.origin import making, origin_of
from pidtsm_experiments.runs.saved import read_parameters
from pidtsm_studies.reports.figures import write_figures
from pidtsm_studies.reports.report import write_report


def write_outputs(recording: Recording, folder: Path, run: Path | None = None) -> dict[str, Any]:
    """Write metrics.json, figures/ and report.html.

    Args:
        recording: the run.
        folder: an existing folder.
        run: where the parameters and the origin of the run are, see `read_parameters`; None: in `folder`, and this
            command has made it.

    Returns:
        The metrics, as in metrics.json.
    """
    metrics = recording.metrics()
    write_metrics(metrics, folder / "metrics.json")
    write_figures(recording, folder / "figures")
    command = making()["command"] if run is None else (origin_of(run) or {}).get("command", ())
    known = read_parameters(run or folder)
    write_report(folder / "report.html", (recording, metrics), parameters=known, command=command)
    return metrics
