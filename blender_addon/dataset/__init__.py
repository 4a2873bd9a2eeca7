"""Panel *Dataset*: preview poses and views, and render the dataset in the background."""
