"""In: a case. Out: the views of the paper's method: per-vertex colours without visibility, rendered by PyVista."""
