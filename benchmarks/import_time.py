"""What `import pyrobocop_pyomo` costs beyond `import pyomo.environ`: processor seconds and modules.

    python benchmarks/import_time.py [--quick]

Each row is a fresh process, repeated; the least of the seconds counts, since other programs only add to them. Python's
compiled files are made in a folder of their own before anything is measured.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile

from table import Table, show_progress

STATEMENTS = {
    "numpy": "import numpy",
    "pyrobocop_pyomo": "import pyrobocop_pyomo",
    "and solve": "import pyrobocop_pyomo; pyrobocop_pyomo.solve",
    "and all public names": "from pyrobocop_pyomo import *",
}
MEASURED = """
import json, sys, time
import pyomo.environ
started, before = time.process_time(), len(sys.modules)
{statement}
print(json.dumps([time.process_time() - started, len(sys.modules) - before]))
"""


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="the package only, once")
    quick = parser.parse_args().quick

    table = Table([("beyond pyomo.environ", "<24"), ("CPU seconds", ">11.2f"), ("modules", ">7d")])
    table.header()
    with tempfile.TemporaryDirectory() as compiled:
        for name, statement in STATEMENTS.items():
            if quick and name != "pyrobocop_pyomo":
                continue
            show_progress(name)
            cost(statement, compiled)
            seconds, modules = min(cost(statement, compiled) for _ in range(1 if quick else 6))
            show_progress("")
            table.add(name, seconds, modules)


def cost(statement: str, compiled: str) -> tuple[float, int]:
    """Processor seconds and modules of a statement in a fresh process, beyond Pyomo's."""
    command = [sys.executable, "-c", MEASURED.format(statement=statement)]
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONDONTWRITEBYTECODE"}
    environment["PYTHONPYCACHEPREFIX"] = compiled
    ended = subprocess.run(command, capture_output=True, text=True, check=True, env=environment)
    seconds, modules = json.loads(ended.stdout)
    return seconds, modules


if __name__ == "__main__":
    main()
