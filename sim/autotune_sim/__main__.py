"""`python -m autotune_sim`: a simulated drive from a shell or a test."""

from __future__ import annotations

import argparse
import sys
import textwrap
from collections.abc import Sequence

from autotune.core.errors import AutotuneError
from autotune.core.garbage import seldom_collected

_EPILOG = (
    "Faults: silent[=SECONDS], unplugged[=SECONDS], power-loss, drive-fault[=CODE], enable-missing, "
    "brake-missing, blocked, hot[=DEGREES], frames-lost[=PERCENT], emcy[=CODE], "
    "sdo-abort=INDEX[:SUB[:CODE]], other-identity[=VENDOR], nvm, stop-fault[=CODE], rpdo-lost[=PERCENT], "
    "second-master[=RAD], status-word[=HEX], fault-reset, snapshot, clear, "
    "and what can break inside the axis: encoder-frozen, "
    "encoder-jump[=RAD], encoder-reversed, encoder-scale[=FACTOR], velocity-unit[=FACTOR], "
    "torque-constant[=FACTOR], torque-reversed, stage-stuck[=NM], runaway[=SHARE], load-step[=SHARE], "
    "load-wave[=SHARE], leaning[=SHARE], inertia-step[=FACTOR], end-stop[=RAD], collision[=RAD], "
    "temperature-frozen, temperature-slow[=SECONDS], temperature-rise[=DEGREES]. WHEN: 2.5 (seconds with operation "
    "enabled), 2.5w (seconds since the start), 500c (SYNC messages), write or write3 (parameter writes), "
    "store (in the middle of storing); at once without it."
)


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="python -m autotune_sim",
        description="A simulated servo drive on a pseudo-terminal: a CANopen node behind an slcan adapter, or a "
        "moteus controller on its serial line.",
        epilog=textwrap.fill(_EPILOG, 100, break_on_hyphens=False),
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("port", help="where the link to the pseudo-terminal is put")
    parser.add_argument("--preset", default="edm-vertical", help="the axis (default: %(default)s)")
    parser.add_argument(
        "--link", default="canopen", choices=("canopen", "moteus"), help="(default: %(default)s)"
    )
    parser.add_argument("--node", type=int, default=5, help="node id (default: %(default)s)")
    parser.add_argument("--seed", type=int, default=0, help="varies the axis; 0 is nominal")
    parser.add_argument(
        "--effect", action="append", default=[], metavar="NAME[=SIZE]", help="physics to plant; repeatable"
    )
    parser.add_argument("--real-time", action="store_true", help="the drive runs on its own clock")
    parser.add_argument(
        "--fault", action="append", default=[], metavar="NAME[=VALUE][@WHEN]", help="to put in; repeatable"
    )
    parser.add_argument("--unfit", default="", metavar="NAME[=SIZE]", help="an axis that must not be tuned")
    parser.add_argument("--counts", type=int, help="encoder counts per revolution (default: the preset's)")
    parser.add_argument(
        "--dead-time",
        type=float,
        default=0.0,
        metavar="SECONDS",
        help="by which the torque comes later than it is demanded, in whole cycles",
    )
    parser.add_argument("--truth", metavar="FILE", help="what is true on the axis is logged there")
    parser.add_argument("--state", metavar="FILE", help="non-volatile memory (default: none is kept)")
    parser.add_argument(
        "--also",
        action="append",
        default=[],
        metavar="PORT",
        help="a further slcan adapter on the bus; repeatable",
    )
    parser.add_argument(
        "--commands", action="store_true", help="reads faults from standard input, ends with it"
    )
    return parser


def main(arguments: Sequence[str] | None = None) -> int:
    """Runs the simulated drive; events go to standard output, one a line."""
    options = _parser().parse_args(arguments)
    from autotune_sim.server import parse_effects, serve  # here, so that --help and mistakes are quick

    try:
        serve(
            options.preset,
            options.port,
            options.node,
            seed=options.seed,
            effects=parse_effects(options.effect),
            link=options.link,
            real_time=options.real_time,
            faults=options.fault,
            state_file=options.state,
            also=options.also,
            commands=options.commands,
            truth=options.truth,
            unfit=options.unfit,
            counts=options.counts,
            dead_time=options.dead_time,
            log=_log,
        )
    except AutotuneError as error:
        sys.stderr.write(f"{error}\n")
        return error.exit_code
    except BrokenPipeError:
        return 1  # nobody reads our log any more: whoever started us is gone
    return 0


def _log(text: str) -> None:
    sys.stdout.write(text + "\n")
    sys.stdout.flush()


if __name__ == "__main__":
    seldom_collected()
    sys.exit(main())
