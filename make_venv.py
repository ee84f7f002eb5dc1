"""Make the virtual environment ``.venv`` and install this package into it: ``python3 make_venv.py ipopt,plot``.

It does what ``python3 -m venv .venv && .venv/bin/pip install -e '.[ipopt,plot]'`` does, also on a Debian or Ubuntu
whose Python comes without ``ensurepip``. Calling it again updates what is there. ``uv`` installs in a tenth of pip's
time; where it cannot (it reads no ``pip.conf``), pip does.
"""

import importlib.util
import os
import shutil
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parent
PYTHON = ROOT / ".venv" / "bin" / "python"


def main(extras):
    """Make the environment unless it is there, then install or update."""
    if sys.version_info < (3, 10):  # noqa: UP036  an older Python is what this line is for
        sys.exit(f"Python 3.10 or newer is needed; this is {sys.version.split()[0]} ({sys.executable}).")
    if not has("pip"):
        make()
    pip = [PYTHON, "-m", "pip", "install", "--quiet", "--disable-pip-version-check"]
    package = ["--editable", f"{ROOT}[{extras}]"]
    with_uv = [PYTHON, "-m", "uv", "pip", "install", "--quiet", "--python", PYTHON, *package]
    if not has("uv"):
        subprocess.run([*pip, "uv"])
    if not has("uv") or subprocess.run(with_uv).returncode:
        run([*pip, *package])


def has(installer):
    """Whether the environment is there with its installer: an attempt that was broken off is made again."""
    version = [PYTHON, "-m", installer, "--version"]
    return PYTHON.exists() and subprocess.run(version, capture_output=True).returncode == 0


def make():
    """By the standard library; where Debian took a part of it away, put the part back first."""
    if importlib.util.find_spec("ensurepip") is None:
        install = ["apt-get", "install", "--yes", "--no-install-recommends", "python3-venv"]
        prefix = privilege()
        if prefix is None or shutil.which("apt-get") is None:
            sys.exit(f"This Python lacks its module ensurepip. Run: sudo {' '.join(install)}")
        os.environ["DEBIAN_FRONTEND"] = "noninteractive"
        run([*prefix, "apt-get", "update", "--quiet"])
        run([*prefix, *install])
    # In a process of its own: this one has already looked for ensurepip in vain.
    run([sys.executable, "-m", "venv", "--clear", ROOT / ".venv"])


def privilege():
    """What to put before a command that needs root; None when there is no way without a password."""
    if os.geteuid() == 0:
        return []
    if shutil.which("sudo") and subprocess.run(["sudo", "-n", "true"], capture_output=True).returncode == 0:
        return ["sudo", "-n"]
    return None


def run(command):
    """Run a command, its output going where ours goes; end with its exit code if it fails."""
    code = subprocess.run(command).returncode
    if code:
        sys.exit(code)


if __name__ == "__main__":
    main(sys.argv[1] if len(sys.argv) > 1 else "ipopt,plot")
