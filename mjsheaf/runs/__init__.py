"""One run: simulating it, and the directory it leaves: data, figures, video, expectations."""
