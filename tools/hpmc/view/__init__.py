"""`./rig view`: a run, live or from its log, in the browser."""
