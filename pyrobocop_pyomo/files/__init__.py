"""Problems with complementarity in files of other programs: ``.nl``, and JSON with functions of CasADi."""

from .file_formats import read_file, write_file
from .file_problem import FilePoint, FileProblem

__all__ = ["FilePoint", "FileProblem", "read_file", "write_file"]
