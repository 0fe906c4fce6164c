"""The MCAP format: records, files, and a writer, for logs of any kind."""
