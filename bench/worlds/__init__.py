"""Worlds: a second simulator for the diagnosis, written apart from `autotune_sim` and `autotune.models`.

    python -m bench.worlds --seed 0 --singles 40 --nulls 20 --out worlds.jsonl --table worlds.md

It shares no line of physics with the library: hysteresis of elements that slip, a drive loop of 8 to 16 kHz, steps
of 12 to 20 µs, laws of its own for every effect, and a distribution of everything that is not the effect.
"""
