"""What a node may measure, one module each.

A measurement has a kernel that gives residual, rows and first channel at a node, or no rows where
the node does not have it, and a function that says which nodes have it and how well. All kernels
take the same arguments. What they predict comes from the sensor model
(``effects.measured_kernels``), so that all effects act there.
"""
