"""Runs the experiments of the H-PMC rig and analyses their logs."""
