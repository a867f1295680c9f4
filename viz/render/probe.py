"""`python -m viz.render.probe`: exit code 0 where 3-D pictures can be drawn, 1 where not. For the Makefile."""

import sys

from .render import can_render

if __name__ == "__main__":
    sys.exit(not can_render())
