"""Speed and accuracy of rendering: what is rendered, by whom, and how long it took and how far off it is."""
