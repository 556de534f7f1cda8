"""Furnaces, form factors and shadows: pixels whose value is known.

Every case renders pixels with next-event estimation and the power heuristic, as the renderer
always does; `sees` is the relative bias that it finds with 90 % power.
"""
