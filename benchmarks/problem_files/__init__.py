"""Problems with complementarity in files of other programs, as models and as numbers."""

from .file_formats import SUFFIXES, read_file
from .file_problem import FilePoint, FileProblem

__all__ = ["SUFFIXES", "FilePoint", "FileProblem", "read_file"]
