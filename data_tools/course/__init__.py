"""The notebooks as a folder of the user's, and the small recordings they read."""

from data_tools.course._copy import FIRST, Copied, copy_notebooks, course_files, home_of_notebooks

__all__ = ["FIRST", "Copied", "copy_notebooks", "course_files", "home_of_notebooks"]
