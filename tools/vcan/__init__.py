"""Private CAN bus and multicast loopback for one command: the parts of tools/with-vcan."""
