"""`AnimationFile`: the file of an animation, which plays where a notebook shows it."""

from __future__ import annotations

import sys
import tempfile
from base64 import b64encode
from pathlib import Path, PosixPath, WindowsPath
from typing import Any

from pyrobocop_pyomo.errors import GeometryError
from pyrobocop_pyomo.optional_imports import animation

if sys.platform == "win32":
    _OwnPath = WindowsPath
else:
    _OwnPath = PosixPath


class AnimationFile(_OwnPath):
    """Path of a GIF or MP4 file; at the end of a notebook cell, its animation plays.

    The notebook holds a copy of the animation, and needs the file no longer.
    """

    __slots__ = ()

    def _repr_html_(self) -> str | None:
        if not self.is_file():
            return None
        data = b64encode(self.read_bytes()).decode("ascii")
        if self.suffix == ".mp4":
            return f'<video controls autoplay loop muted src="data:video/mp4;base64,{data}"></video>'
        return f'<img alt="animation" src="data:image/gif;base64,{data}"/>'


def animation_file(path: str | Path | None) -> AnimationFile:
    """Where an animation goes: a name that ends in ``.mp4`` as it is, any other as ``.gif``; None: a temporary file.

    Raises
    ------
    GeometryError
        For MP4 without the program that writes it.
    """
    if path is None:
        with tempfile.NamedTemporaryFile(prefix="animation_", suffix=".gif", delete=False) as made:
            return AnimationFile(made.name)
    if Path(path).suffix.lower() != ".mp4":
        return AnimationFile(Path(path).with_suffix(".gif"))
    if not animation.FFMpegWriter.isAvailable():
        raise GeometryError(
            f"'{path}': MP4 files are written by the program ffmpeg, and Matplotlib does not find it. Install it (apt "
            "install ffmpeg, brew install ffmpeg, conda install ffmpeg), set matplotlib.rcParams['animation."
            "ffmpeg_path'], or write a file that ends in .gif, which needs nothing."
        )
    return AnimationFile(path)


def frame_writer(path: AnimationFile, frames_per_second: float) -> Any:
    """What collects the frames of a file, and writes it at the end."""
    kind = animation.FFMpegWriter if path.suffix.lower() == ".mp4" else animation.PillowWriter
    return kind(fps=frames_per_second)
