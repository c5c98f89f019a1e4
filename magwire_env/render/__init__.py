"""Pictures of an env: frames (pygame-ce), a window to play in, a page in the browser (viser).

Importing this package loads none of them; what needs the extra ``view`` says so in one line where it is missing.
"""
