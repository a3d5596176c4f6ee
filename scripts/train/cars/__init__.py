"""Parametric cars, lorries and buses as meshes, and the shape atlas."""
