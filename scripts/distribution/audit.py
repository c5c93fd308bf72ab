"""Whether locked packages have known vulnerabilities, by the advisory database of the package index."""

import json
import subprocess
from pathlib import Path

from distribution.tools import ROOT, DistributionError, outside


def audit(lock: Path, programs: Path, *options: str) -> str:
    """What pip-audit of a folder of programs finds in a lock, in a sentence; `options` may name another database.

    Without the database nothing is known, which the sentence tells; the checks on GitHub fail then.

    Raises:
        DistributionError: a package has a known vulnerability.
    """
    words = ["--disable-pip", "--require-hashes", "--progress-spinner=off", "--format=json", *options, "-r", str(lock)]
    done = subprocess.run(
        [programs / "pip-audit", *words], env=outside(), cwd=ROOT, capture_output=True, text=True, check=False
    )
    try:
        found = json.loads(done.stdout)["dependencies"]
    except (ValueError, KeyError):
        lines = done.stderr.strip().splitlines() or ["no answer"]
        return f"{lock.name}: not audited ({lines[-1]})"
    bad = [
        f"{each['name']} {each['version']}: {', '.join(one['id'] for one in each['vulns'])}"
        for each in found
        if each.get("vulns")
    ]
    if bad:
        raise DistributionError(f"{lock.name} has known vulnerabilities: " + "; ".join(bad))
    unknown = [each["name"] for each in found if "skip_reason" in each]
    if len(unknown) == len(found):
        return f"{lock.name}: not audited (none of its {len(found)} packages is in the database)"
    known = f"{lock.name}: no known vulnerability in {len(found) - len(unknown)} packages"
    return known + (f"; not in the database, so not audited: {', '.join(unknown)}" if unknown else "")
