"""Tables, figures, video and report of a comparison."""
