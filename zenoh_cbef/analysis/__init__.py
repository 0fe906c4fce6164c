"""Numbers and pictures from a trace: metrics, figures, report."""
