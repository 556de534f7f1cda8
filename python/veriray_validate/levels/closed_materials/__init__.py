"""Materials against closed forms: furnaces, Fresnel, plates, plastic, passes.

Scalar (unpolarised) Fresnel theory throughout.
"""
