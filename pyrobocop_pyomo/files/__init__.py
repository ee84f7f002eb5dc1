"""Problems with complementarity in files that other programs read and write: ``.nl``, and JSON with functions of CasADi."""

from .file_problem import FilePoint, FileProblem
from .problem_files import read_problem, write_model

__all__ = ["FilePoint", "FileProblem", "read_problem", "write_model"]
