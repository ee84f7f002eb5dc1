"""What setup.cfg cannot say: how C parts are compiled, what such a wheel is called, where the links of README.md lead.

Whoever installs from source compiles the libraries in place, unless PYROBOCOP_NATIVE is "off" or there is no compiler:
then NumPy does what they would do. They are loaded by ctypes and know nothing of Python: a wheel with them is for one
platform and any Python 3.

README.md has relative links, which lead nowhere on a package index. Where PYROBOCOP_REPOSITORY is the address of the
repository, as in the release workflow, they lead to the files there that have the tag of this version.
"""

import os
import re
import runpy
import sys
from pathlib import Path

from setuptools import Distribution, setup
from setuptools.command.bdist_wheel import bdist_wheel

REPOSITORY = os.environ.get("PYROBOCOP_REPOSITORY", "").rstrip("/")
# Code stays as it is; of what follows "](", neither addresses with a scheme nor anchors of the page are relative.
CODE_OR_LINK = re.compile(r"```.*?```|`[^`]*`|(?<=\]\()(?![\w+.-]+:|#)(?P<path>[^)\s]+)", re.DOTALL)
PICTURES = (".png", ".gif", ".jpg", ".svg")


def absolute_links(text: str, repository: str, tag: str) -> str:
    """Markdown whose relative links and pictures are those of a tag in a repository."""

    def absolute(found: re.Match[str]) -> str:
        path = found["path"]
        if path is None:
            return found[0]
        return f"{repository}/{'raw' if path.endswith(PICTURES) else 'blob'}/{tag}/{path}"

    return CODE_OR_LINK.sub(absolute, text)


def compile_libraries() -> None:
    """Put the libraries beside their sources, or say why there are none."""
    native = runpy.run_path("pyrobocop_pyomo/native/shared_library.py")
    for name in native["LIBRARIES"] if native["native_allowed"]() else ():
        try:
            native["compile_library"](name)
        except OSError as error:
            sys.stderr.write(f"without the compiled part '{name}': {error}\n")


def compiled_libraries() -> list[Path]:
    """What a wheel takes along."""
    return [path for kind in ("so", "dylib", "dll") for path in Path("pyrobocop_pyomo").rglob(f"*.{kind}")]


class PlatformWheel(bdist_wheel):
    """A wheel for this platform and every Python 3."""

    def get_tag(self) -> tuple[str, str, str]:
        """See the base class."""
        return "py3", "none", super().get_tag()[2]


class Package(Distribution):
    """What setup.cfg says, with compiled libraries and addresses."""

    def has_ext_modules(self) -> bool:
        """Whether the files go where compiled ones do."""
        return bool(compiled_libraries())

    def parse_config_files(self, *arguments: object, **options: object) -> None:
        """See the base class."""
        super().parse_config_files(*arguments, **options)
        if REPOSITORY:
            tag = f"v{self.metadata.version}"
            self.metadata.long_description = absolute_links(self.metadata.long_description, REPOSITORY, tag)
            self.metadata.project_urls = {
                "Source": REPOSITORY,
                "Issues": f"{REPOSITORY}/issues",
                "Changelog": f"{REPOSITORY}/blob/{tag}/CHANGELOG.md",
                **self.metadata.project_urls,
            }


if __name__ == "__main__":
    if {"bdist_wheel", "editable_wheel"} & set(sys.argv):
        compile_libraries()
    setup(distclass=Package, cmdclass={"bdist_wheel": PlatformWheel} if compiled_libraries() else {})
