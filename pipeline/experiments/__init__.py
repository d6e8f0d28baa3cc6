"""The paper's experiments on any drive: figures with numbers, one module each."""
