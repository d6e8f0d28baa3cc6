"""What may make a fused path doubtful: one module for each kind of evidence."""
