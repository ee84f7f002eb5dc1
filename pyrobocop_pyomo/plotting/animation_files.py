"""`AnimationFile`: the file of an animation, which plays where a notebook shows it."""

from __future__ import annotations

import shutil
import subprocess
import sys
import tempfile
import weakref
from base64 import b64encode
from pathlib import Path, PosixPath, WindowsPath
from typing import Any

from pyrobocop_pyomo.errors import ObstacleError
from pyrobocop_pyomo.optional_imports import animation, matplotlib

if sys.platform == "win32":
    _OwnPath = WindowsPath
else:
    _OwnPath = PosixPath


class AnimationFile(_OwnPath):
    """Path of a GIF or MP4 file; at the end of a notebook cell, its animation plays.

    The notebook holds a copy of the animation, and needs the file no longer. A temporary file is there as long as this
    object, and is removed with it, at the latest when Python ends; `save` keeps it.
    """

    def save(self, path: str | Path) -> AnimationFile:
        """Write the animation to another file, and return its path.

        Parameters
        ----------
        path : str or Path
            A name that ends in ``.mp4`` makes a film (by the program ffmpeg), any other a GIF, whose suffix is made
            ``.gif``.

        Raises
        ------
        ObstacleError
            Where ffmpeg is needed and not found, or fails.
        FileNotFoundError
            When the file of this animation is gone.
        """
        target = animation_file(path)
        if target.suffix.lower() == self.suffix.lower():
            if not (target.exists() and target.samefile(self)):
                shutil.copyfile(self, target)
            return target
        program = _ffmpeg(path)
        self.stat()
        # Players want an even number of pixels, and colours at half the resolution.
        filters = ["-vf", "pad=ceil(iw/2)*2:ceil(ih/2)*2", "-pix_fmt", "yuv420p"] if _is_film(target) else []
        command = [program, "-y", "-v", "error", "-i", str(self), *filters, str(target)]
        made = subprocess.run(command, capture_output=True, text=True, check=False)
        if made.returncode:
            raise ObstacleError(f"ffmpeg did not turn '{self}' into '{target}': {made.stderr.strip()}")
        return target

    def _repr_html_(self) -> str | None:
        if not self.is_file():
            return None
        data = b64encode(self.read_bytes()).decode("ascii")
        if _is_film(self):
            return f'<video controls autoplay loop muted src="data:video/mp4;base64,{data}"></video>'
        return f'<img alt="animation" src="data:image/gif;base64,{data}"/>'


def animation_file(path: str | Path | None) -> AnimationFile:
    """Where an animation goes: ``.mp4`` as named, any other as ``.gif``; None: a temporary file.

    Raises
    ------
    ObstacleError
        For MP4 without the program that writes it, and for HTML.
    """
    if path is None:
        folder = tempfile.mkdtemp(prefix="pyrobocop_")
        made = AnimationFile(Path(folder) / "animation.gif")
        weakref.finalize(made, shutil.rmtree, folder, ignore_errors=True)
        return made
    if Path(path).suffix.lower() == ".html":
        raise ObstacleError(f"'{path}': pages are not written any more. Name a .gif or an .mp4 file.")
    if not _is_film(Path(path)):
        return AnimationFile(Path(path).with_suffix(".gif"))
    _ffmpeg(path)
    return AnimationFile(path)


def frame_writer(path: AnimationFile, frames_per_second: float) -> Any:
    """What collects the frames of a file, and writes it at the end."""
    kind = animation.FFMpegWriter if _is_film(path) else animation.PillowWriter
    return kind(fps=frames_per_second)


def _is_film(path: Path) -> bool:
    return path.suffix.lower() == ".mp4"


def _ffmpeg(path: str | Path) -> str:
    """The program that writes films; an error where it is not found."""
    if not animation.FFMpegWriter.isAvailable():
        raise ObstacleError(
            f"'{path}': MP4 files are written by the program ffmpeg, and Matplotlib does not find it. Install it (apt "
            "install ffmpeg, brew install ffmpeg, conda install ffmpeg), set matplotlib.rcParams['animation."
            "ffmpeg_path'], or write a file that ends in .gif, which needs nothing."
        )
    return str(matplotlib.rcParams["animation.ffmpeg_path"])
