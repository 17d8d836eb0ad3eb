"""The CAN bus in words, live or recorded: `./rig can`."""
