"""The workbench: a page in the browser that writes scenes, runs them and compares what came out."""
