"""A benchmark as its users start it."""

import signal
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[2]


def run(script: str, *args: str, timeout_s: float) -> subprocess.CompletedProcess[str]:
    """Run a benchmark to its end; one that is late takes its processes and hosts along."""
    command = [sys.executable, str(ROOT / "benchmarks" / script), *args]
    process = subprocess.Popen(
        command, cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True
    )
    try:
        output, _ = process.communicate(timeout=timeout_s)
    except subprocess.TimeoutExpired:
        process.send_signal(signal.SIGINT)
        process.communicate(timeout=60)
        raise
    return subprocess.CompletedProcess(command, process.returncode, output)
