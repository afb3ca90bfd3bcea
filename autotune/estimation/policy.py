"""Every threshold that decides: what is named, left out, refused or believed; numerical tolerances stay elsewhere.

Each carries its unit, its meaning and its evidence; `docs/thresholds.md` shows what verdicts do when one of them
is changed. Another policy is an argument of `diagnose`, never a change in a module.
"""

from __future__ import annotations

from dataclasses import dataclass, field, fields
from typing import Any


def _threshold(value: float, unit: str, meaning: str, evidence: str) -> Any:
    return field(default=value, metadata={"unit": unit, "meaning": meaning, "evidence": evidence})


@dataclass(frozen=True, slots=True, kw_only=True)
class Policy:
    """Thresholds that decide, each with unit, meaning and evidence in its metadata."""

    # Screening: which candidates are worth a fit inside the twin
    least_gain: float = _threshold(
        0.03,
        "1",
        "fall of the squared error on experiments held out, below which a candidate is nothing",
        "where nothing is planted the best candidate gains at most 0.02",
    )
    clear_gain: float = _threshold(
        0.1,
        "1",
        "gain that counts whatever its scatter over chunks",
        "five times what the best candidate gains by chance",
    )
    least_z: float = _threshold(
        3.0,
        "standard errors",
        "by which a smaller gain must be beyond its scatter over chunks",
        "one chance in a thousand, for each of sixteen candidates",
    )
    least_gain_without_twin: float = _threshold(
        0.12,
        "1",
        "the least gain where no controller is known",
        "what an invented controller makes of a perfect model reaches a tenth",
    )
    least_gain_single: float = _threshold(
        0.08,
        "1",
        "the least gain without repeats",
        "smaller gains are as often the measurement chain as the axis",
    )
    least_z_single: float = _threshold(
        2.5,
        "standard errors",
        "the least z without repeats",
        "surrogates of random phase pass 2 in a tenth of the cases",
    )
    least_z_by_phase: float = _threshold(
        2.0,
        "standard errors",
        "the same where ranges of phase are held out",
        "ranges of phase differ more from one another than stretches of time",
    )
    surrogates_beaten: float = _threshold(
        0.9,
        "1",
        "of residuals with random phases, that a candidate must gain more than",
        "without it smooth residuals that are no effect pass in 18 of 60 cases",
    )
    promising_fall: float = _threshold(
        0.009,
        "1",
        "fall of the cost in a short fit that is followed to its end",
        "a third of the least gain, as two steps find a third of what ten find",
    )
    close_start: float = _threshold(
        0.4,
        "1",
        "of the best start's fall: starts that come so near are followed too",
        "gaps and Stribeck velocities have second minima there",
    )
    near_best_beside: float = _threshold(
        0.3,
        "1",
        "of the best short fit's fall: what a further effect must reach to be followed",
        "pairs named are the same with 0, at twice the time",
    )
    near_worth_beside: float = _threshold(
        0.5,
        "1",
        "of the fall that a further effect is worth having for: the same",
        "a fit to its end seldom doubles what the short one found",
    )
    most_refits: int = _threshold(
        4,
        "fits",
        "candidates fitted inside the twin in one round",
        "the right one was among the first three in all of 397 runs",
    )
    most_effects: int = _threshold(
        3, "effects", "effects added to a model at most", "a fourth was never needed beside a planted pair"
    )
    worth_refit: float = _threshold(
        0.35,
        "1",
        "of the best candidate's gain: less is not worth a fit inside the twin",
        "no right effect gained less beside a wrong one",
    )
    worth_refit_beside: float = _threshold(
        0.6, "1", "the same for a further effect", "beside another effect gains are less spread"
    )
    close_rival: float = _threshold(
        0.75,
        "1",
        "of the best gain: what is fitted too though an effect is found that can be named",
        "rivals with less never explained as much",
    )
    clear_fall: float = _threshold(
        0.2,
        "1",
        "fall of the cost at which the veto trajectory is asked although hold-outs see no gain",
        "no candidate falls so far where nothing is missing",
    )
    generic_gain: float = _threshold(
        0.05,
        "1",
        "gain of a free function of one coordinate that says something is missing there",
        "free functions gain up to 0.03 on noise",
    )
    generic_lead: float = _threshold(
        1.5,
        "1",
        "times the best physical gain: such a function says the effect is unknown",
        "laws that differ from the library's: 15 of 15 unknown",
    )

    # Naming: how much of what can be explained must be explained
    named: float = _threshold(
        0.9,
        "1",
        "share of the explainable error on training and veto, for a name",
        "true effects reach 0.96, wrong ones 0.13",
    )
    named_with_rest: float = _threshold(
        0.95,
        "1",
        "the same where something that repeats is left beyond doubt",
        "laws that resemble the true one reach 0.9 to 0.94",
    )
    partly: float = _threshold(
        0.5,
        "1",
        "share below which nothing is said of an effect",
        "wrong effects reach 0.13, with laws that resemble 0.45",
    )
    rest_errors: float = _threshold(
        3.0, "standard errors", "of the repeatable rest, to be beyond doubt", "one chance in a thousand"
    )
    rest_part: float = _threshold(
        0.03, "1", "of the noise: a smaller rest is none", "the twin's own bias comes to a hundredth"
    )
    drift_z: float = _threshold(
        6.0,
        "standard errors",
        "of a friction level that differs between repeats",
        "thermal drift 12 of 12, no false alarm in 171",
    )
    drift_part: float = _threshold(
        0.1, "1", "of what differs between repeats: a smaller drift is none", "the same runs"
    )

    # A further effect beside those that are found
    worth_beside: float = _threshold(
        0.01,
        "1",
        "of what is explained: the least that a further effect must explain",
        "second names that are not there explain up to 0.008",
    )
    clear_beside: float = _threshold(
        0.1,
        "1",
        "of what is left: an effect that explains so much may be smaller",
        "a weak effect beside a strong one",
    )
    worth_if_clear: float = _threshold(
        0.005,
        "1",
        "of what is explained: the least in that case",
        "law mismatch of a strong first effect leaves up to 0.005",
    )
    chance_of_contact: float = _threshold(
        0.3,
        "1",
        "of what is left between two masses: what two fits of one model differ by",
        "a fifth was seen by chance",
    )
    negligible: float = _threshold(
        0.02,
        "1",
        "of what is explained: an effect that is worth less is dropped",
        "true second effects are worth 0.03 and more",
    )
    negligible_left: float = _threshold(
        0.05, "1", "of what is left: likewise, both must hold", "the same runs"
    )
    plainly_needed: float = _threshold(
        20.0,
        "1",
        "times what is negligible: so much needs no fit to be seen",
        "fits without the effect never won back a tenth of it",
    )

    # Refinement: when a fit is carried on
    refined: float = _threshold(
        0.99, "1", "share from which a fit is not carried on", "more rounds change no verdict"
    )
    nearly: float = _threshold(
        0.8, "1", "share below which more rounds will not make a name", "no fit rose from there to 0.9"
    )
    clearly_less: float = _threshold(
        0.8,
        "1",
        "of what was left: what another start must leave to be taken",
        "chance between two fits is a fifth",
    )

    # Spring or gap
    spring_instead: float = _threshold(
        1.2,
        "1",
        "of what a gap leaves: what a spring alone may leave to be preferred",
        "chance between two fits is a fifth",
    )
    spring_instead_beside: float = _threshold(
        1.1,
        "1",
        "the same beside other effects, or where it is plainly a gap",
        "there a gap takes up what is missing",
    )
    hardly_a_gap: float = _threshold(
        0.3,
        "1",
        "of the contact's twist at Coulomb friction: a smaller gap is none",
        "gaps planted come to 0.5 and more",
    )

    # Verdict
    alike: float = _threshold(
        0.03,
        "1",
        "of the fall: rivals that come so near cannot be told apart",
        "the right one leads its rivals by 0.05 and more",
    )
    alike_single: float = _threshold(
        0.1, "1", "the same from one trajectory", "in one recording rivals tie within a few hundredths"
    )
    apart_z: float = _threshold(
        2.0, "standard errors", "by which the better of two models must err less", "one chance in forty"
    )
    structure_errors: float = _threshold(
        1.5, "standard errors", "of the repeatable rest that says something is missing", "no null run in 212"
    )
    structure_part: float = _threshold(
        0.15, "1", "of the noise: the least such rest", "below it no effect can be named either"
    )
    line_part: float = _threshold(
        0.05,
        "1",
        "of the residual's variance: the least disturbance that follows the clock",
        "chance lines come to a hundredth",
    )
    line_contrast: float = _threshold(
        60.0,
        "1",
        "times the median power: the least line",
        "exponential noise reaches 20 in ten thousand bins",
    )
    line_everywhere: float = _threshold(
        0.8, "1", "of the experiments that must hold it alike", "a motion's harmonic is in one or two"
    )
    rival_gain: float = _threshold(
        0.5,
        "1",
        "of the named effect's gain: an effect with less is no rival",
        "rivals that confused a verdict gained 0.7 and more",
    )
    term_chance: float = _threshold(
        0.001,
        "1",
        "chance of a term that is not there to be kept (Wald)",
        "a dozen are looked at in every fit",
    )

    # Confirmation by another trajectory
    confirming_gain: float = _threshold(
        0.3,
        "1",
        "fall of the error there that counts whatever its scatter",
        "wrong effects raise the error, some sevenfold",
    )
    confirming_margin: float = _threshold(
        0.1,
        "1",
        "by which an effect must err less there than its rivals, evenly",
        "rivals differ there by a hundredth or by half",
    )
    lost: float = _threshold(
        10.0,
        "1",
        "times the mean square of the fit: where a model is so far off nothing is compared",
        "a fit of little motion carried to much",
    )

    # What one recording can show
    least_part: float = _threshold(
        0.007,
        "1",
        "of the torque's rms: a smaller effect is as often the measurement chain",
        "10 wrong names in 100 runs without it",
    )
    clear_single_gain: float = _threshold(
        0.5, "1", "gain of an effect that may be smaller", "nothing but physics explains half"
    )
    clear_single_part: float = _threshold(
        0.002, "1", "of the torque's rms: the least of such an effect", "resolution of 12 bits"
    )
    least_counts: float = _threshold(
        5.0,
        "counts",
        "of the encoder: shorter displacements and gaps cannot be seen",
        "rounding of two positions and their filter",
    )
    least_warming: float = _threshold(
        5.0, "s", "the shortest time constant of a warming", "within seconds it is the course of one move"
    )
    least_rests: int = _threshold(
        6, "rests", "for friction that grows with rest", "fewer times of rest than the law has parameters"
    )
    rest_ratio: float = _threshold(
        3.0, "1", "longest over shortest rest, at least", "within a factor of three every start is alike"
    )
    beyond: float = _threshold(
        1.5,
        "1",
        "times the cut-off or what the sampling allows: what cannot be seen",
        "its flank is still in the band",
    )
    large_rest: float = _threshold(
        0.03,
        "1",
        "of the torque: less may be left without a word",
        "measurement chains of others leave a few hundredths",
    )
    most_noise: float = _threshold(
        0.5,
        "1",
        "of the rest: what must be alike where the motion is alike to be structure",
        "of noise it is 1",
    )

    # The model that everything is compared with
    twin_worse: float = _threshold(
        2.0,
        "1",
        "times the cost without twin: a twin that makes it worse is not used",
        "it rings where the axis did not",
    )
    misfit: float = _threshold(
        0.8,
        "1",
        "of the torque's variance: a model that leaves more is of another axis",
        "wrong signs leave more than all",
    )
    outlying: float = _threshold(
        12.0,
        "1",
        "times the median power: a quarter of a second with more is left out",
        "starts, stops and blows; noise reaches 3",
    )
    lonely: float = _threshold(
        6.0, "standard deviations", "samples beyond are left out", "a normal error comes there once in 10⁹"
    )
    few: float = _threshold(
        0.02, "1", "of the rows: more of them are structure and stay", "faults of a file come to a thousandth"
    )
    fit_loose: float = _threshold(
        1.0,
        "1",
        "relative standard error from which inertia or friction is not known",
        "its interval holds zero",
    )
    wrong_sign: float = _threshold(
        0.3,
        "1",
        "of the torque: what a negative inertia must come to, to be a wrong sign",
        "chance gives a hundredth",
    )

    # The controller
    controller_explains: float = _threshold(
        0.999,
        "1",
        "share of the demand's variance: with less a controller drives no twin",
        "gains wrong by a tenth do no harm, by three tenths they give false names",
    )
    controller_better: float = _threshold(
        0.1,
        "1",
        "of what a law leaves: what another must leave to be taken instead",
        "a gain wrong by a tenth can still explain 0.999",
    )
    answer_explains: float = _threshold(
        0.99,
        "1",
        "share of the torque that is linear in reference and position: just a controller's answer",
        "torque of friction and ripple is 0.3 to 0.97",
    )
    reference_causes: float = _threshold(
        0.25,
        "1",
        "of the velocity's variance: the reference explains at least so much where it causes it",
        "followed motion 0.9, foreign motion 0.05",
    )
    answer_holds: float = _threshold(
        0.25,
        "1",
        "of the torque's rms: an answer to position comes to so much",
        "a spring that one recording shows is a tenth",
    )


@dataclass(frozen=True, slots=True)
class Threshold:
    """One of them, for tables."""

    name: str
    value: float
    unit: str
    meaning: str
    evidence: str


def thresholds(policy: Policy | None = None) -> tuple[Threshold, ...]:
    """All of a policy, in the order in which they stand."""
    policy = POLICY if policy is None else policy
    return tuple(
        Threshold(
            one.name, getattr(policy, one.name), **{key: str(text) for key, text in one.metadata.items()}
        )
        for one in fields(Policy)
    )


POLICY = Policy()
"""The one that is used where no other is given."""
