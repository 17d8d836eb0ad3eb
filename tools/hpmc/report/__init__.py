"""One HTML page of a run: `./rig report`."""
