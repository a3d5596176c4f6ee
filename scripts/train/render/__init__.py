"""An OpenGL renderer, and pictures and videos with truth that it makes."""
