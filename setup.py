"""Everything is said in setup.cfg; here only what a wheel is called that brings compiled libraries.

They are loaded by ctypes and know nothing of Python: such a wheel is for one platform, and for any Python 3.
"""

from pathlib import Path

from setuptools import Distribution, setup
from setuptools.command.bdist_wheel import bdist_wheel

LIBRARIES = [path for kind in ("so", "dylib", "dll") for path in Path("pyrobocop_pyomo").rglob(f"*.{kind}")]


class PlatformWheel(bdist_wheel):
    """A wheel for this platform and every Python 3."""

    def get_tag(self) -> tuple[str, str, str]:
        """See the base class."""
        return "py3", "none", super().get_tag()[2]


class WithLibraries(Distribution):
    """What goes where compiled files go."""

    def has_ext_modules(self) -> bool:
        """See the base class."""
        return True


if LIBRARIES:
    setup(distclass=WithLibraries, cmdclass={"bdist_wheel": PlatformWheel})
else:
    setup()
