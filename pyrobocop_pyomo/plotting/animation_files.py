"""`AnimationFile`: the file of an animation, which plays where a notebook shows it."""

from __future__ import annotations

import shutil
import tempfile
import weakref
from base64 import b64encode
from pathlib import Path

from pyrobocop_pyomo.errors import ObstacleError
from pyrobocop_pyomo.optional_imports import animation


class AnimationFile(type(Path())):  # type: ignore[misc]  # PosixPath, or WindowsPath
    """Path of a GIF or MP4 file; at the end of a notebook cell, its animation plays.

    The notebook holds a copy of the animation, and needs the file no longer. A temporary file is there as long as this
    object, and is removed with it, at the latest when Python ends; `save` keeps it.
    """

    def save(self, path: str | Path) -> AnimationFile:
        """Copy the animation to another file, and return its path.

        Parameters
        ----------
        path : str or Path
            Its suffix is made that of this file: films are written by ``animate(path)``.

        Raises
        ------
        FileNotFoundError
            When the file of this animation is gone.
        """
        target = AnimationFile(Path(path).with_suffix(self.suffix))
        if not (target.exists() and target.samefile(self)):
            shutil.copyfile(self, target)
        return target

    def _repr_html_(self) -> str | None:
        if not self.is_file():
            return None
        data = b64encode(self.read_bytes()).decode("ascii")
        if is_film(self):
            return f'<video controls autoplay loop muted src="data:video/mp4;base64,{data}"></video>'
        return f'<img alt="animation" src="data:image/gif;base64,{data}"/>'


def animation_file(path: str | Path | None) -> AnimationFile:
    """Where an animation goes: ``.mp4`` as named, any other as ``.gif``; None: a temporary file.

    Raises
    ------
    ObstacleError
        For MP4 without the program that writes it.
    """
    if path is None:
        folder = tempfile.mkdtemp(prefix="pyrobocop_")
        made = AnimationFile(Path(folder) / "animation.gif")
        weakref.finalize(made, shutil.rmtree, folder, ignore_errors=True)
        return made
    if not is_film(Path(path)):
        return AnimationFile(Path(path).with_suffix(".gif"))
    if not animation.FFMpegWriter.isAvailable():
        raise ObstacleError(
            f"'{path}': MP4 files are written by the program ffmpeg, and Matplotlib does not find it. Install it (apt "
            "install ffmpeg, brew install ffmpeg, conda install ffmpeg), set matplotlib.rcParams['animation."
            "ffmpeg_path'], or write a file that ends in .gif, which needs nothing."
        )
    return AnimationFile(path)


def is_film(path: Path) -> bool:
    """Whether a file is written by ffmpeg; others are GIFs."""
    return path.suffix.lower() == ".mp4"
