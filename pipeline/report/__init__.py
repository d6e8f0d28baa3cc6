"""report.html: one page that shows a run, without the network."""
