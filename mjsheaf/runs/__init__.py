"""One run as a directory: data, figures, video, expectations."""
