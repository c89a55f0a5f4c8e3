"""The only room that names Taichi: its language, and its start on a back end in a precision."""
