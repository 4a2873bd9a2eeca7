"""Panel *Dataset*: preview a view, and render the dataset in the background."""
