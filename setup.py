"""What setup.cfg cannot say: how C parts are compiled, what such a wheel is called, where the links of README.md lead.

Whoever installs from source compiles the libraries, unless PYROBOCOP_NATIVE is "off" or there is no compiler: then
NumPy does what they would do. In a clone that is ``python setup.py build_ext --inplace``. They are loaded by ctypes and
know nothing of Python: a wheel with them is for one platform and any Python 3.

README.md has relative links, which lead nowhere on a package index. Where PYROBOCOP_REPOSITORY is the address of the
repository, as in the release workflow, they lead to the files there that have the tag of this version.
"""

import os
import re
import runpy
import sys
from pathlib import Path

from setuptools import Distribution, Extension, setup
from setuptools.command.bdist_wheel import bdist_wheel
from setuptools.command.build_ext import build_ext

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


ROOT = Path(__file__).absolute().parent
NATIVE = runpy.run_path(str(ROOT / "pyrobocop_pyomo" / "native" / "shared_library.py"))


def libraries() -> list[Extension]:
    """The libraries beside their sources; where one cannot be compiled, the package is installed without it."""
    found = []
    for name in NATIVE["LIBRARIES"] if NATIVE["native_allowed"]() else ():
        files = [path.relative_to(ROOT) for path in NATIVE["library_sources"](name)]
        sources, headers = ([path.as_posix() for path in files if path.suffix == kind] for kind in (".c", ".h"))
        package = ".".join(files[0].parent.parts)
        flags = [flag for flag in NATIVE["FLAGS"] if flag not in ("-fPIC", "-shared")]
        mathematics = [] if sys.platform == "win32" else ["m"]
        options = {"depends": headers, "libraries": mathematics, "extra_compile_args": flags}
        found.append(Extension(f"{package}.{name}", sources, optional=True, **options))
    return found


class CompiledLibraries(build_ext):
    """Libraries for ctypes, which know nothing of Python."""

    def get_ext_filename(self, fullname: str) -> str:
        """See the base class."""
        *packages, name = fullname.split(".")
        return os.path.join(*packages, NATIVE["library_file"](name).name)

    def get_export_symbols(self, ext: Extension) -> list[str]:
        """See the base class."""
        return []


class PlatformWheel(bdist_wheel):
    """A wheel for this platform and every Python 3."""

    def get_tag(self) -> tuple[str, str, str]:
        """See the base class."""
        return "py3", "none", super().get_tag()[2]


class Package(Distribution):
    """What setup.cfg says, with addresses."""

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
    setup(
        distclass=Package,
        ext_modules=libraries(),
        cmdclass={"build_ext": CompiledLibraries, **({"bdist_wheel": PlatformWheel} if libraries() else {})},
    )
