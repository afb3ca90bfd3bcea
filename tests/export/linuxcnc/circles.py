#!/usr/bin/python3
"""Stands where LinuxCNC's screen would: switches the machine on and runs the circles, then goes."""

import subprocess
import sys
import time

import linuxcnc

RADIUS = 5.0  # mm: 1 rad of the motors
FEEDS = (1885.0, 942.5)  # mm/min: one turn a second, and one in two
PLAYED = {"none": ("M65 P0", "M65 P1"), "exported": ("M65 P1", "M64 P0"), "inverse": ("M65 P0", "M64 P1")}
TURNS = {"none": (2, 2), "exported": (6, 3), "inverse": (6, 3)}
"""What is compensated is near the encoder's resolution, and needs the mean of more turns."""
PATIENCE = 90.0


def wait(stat, ready):
    """Polls until `ready`; gives up where the controller hangs."""
    until = time.monotonic() + PATIENCE
    while True:
        stat.poll()
        if ready(stat):
            return
        if time.monotonic() > until:
            sys.exit("the controller did not get there in time")
        time.sleep(0.02)


def mdi(command, stat, text):
    """Runs one line to its end."""
    command.mdi(text)
    command.wait_complete(PATIENCE)
    wait(stat, lambda s: s.interp_state == linuxcnc.INTERP_IDLE and s.inpos)


def main():
    stat, command = linuxcnc.stat(), linuxcnc.command()
    with open("samples.txt", "w") as file:
        log = subprocess.Popen(["halsampler"], stdout=file)
        command.state(linuxcnc.STATE_ESTOP_RESET)
        command.wait_complete()
        command.state(linuxcnc.STATE_ON)
        command.wait_complete()
        wait(stat, lambda s: s.task_state == linuxcnc.STATE_ON)
        command.mode(linuxcnc.MODE_MDI)
        command.wait_complete()
        mdi(command, stat, f"G21 G17 G90 G94 G64 G1 X{RADIUS:g} Y0 F1200")
        for played, switches in PLAYED.items():
            for switch in switches:
                mdi(command, stat, switch)
            mdi(command, stat, "G4 P0.6")
            for feed, turns in zip(FEEDS, TURNS[played], strict=True):
                mdi(command, stat, f"G2 X{RADIUS:g} Y0 I{-RADIUS:g} J0 P{turns} F{feed:g}")
                mdi(command, stat, "G4 P0.1")
        log.terminate()
        log.wait()


main()
