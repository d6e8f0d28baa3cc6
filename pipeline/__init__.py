"""The application: command line, stages, cache, configuration, reports."""
