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
        "prototype study: where nothing is planted the best candidate gains at most 0.02",
    )
    clear_gain: float = _threshold(
        0.1,
        "1",
        "gain that counts whatever its scatter over chunks",
        "prototype study: five times the largest gain where nothing is planted",
    )
    least_z: float = _threshold(
        3.0,
        "standard errors",
        "by which a smaller gain must be beyond its scatter over chunks",
        "prototype study; one chance in a thousand for each candidate",
    )
    least_gain_single: float = _threshold(
        0.08,
        "1",
        "the least gain without repeats",
        "reasoned: smaller gains are as often the measurement chain as the axis",
    )
    least_z_single: float = _threshold(
        2.5, "standard errors", "the least z without repeats", "study of measured data, beside surrogates"
    )
    surrogates_beaten: float = _threshold(
        0.9,
        "1",
        "of residuals with random phases, that a candidate must gain more than",
        "study of measured data: without it 18 of 60 residuals with random phases passed",
    )
    worth_refit: float = _threshold(
        0.35,
        "1",
        "of the best candidate's gain: less is not worth a fit inside the twin",
        "bench.thresholds: at 1.4 thermal drift beside a spring is not found",
    )
    clear_fall: float = _threshold(
        0.2,
        "1",
        "fall of the cost at which the veto trajectory is asked although hold-outs see no gain",
        "reasoned: no candidate falls so far where nothing is missing",
    )
    generic_gain: float = _threshold(
        0.05,
        "1",
        "gain of a free function of one coordinate that says something is missing there",
        "prototype study, together with the lead",
    )
    generic_lead: float = _threshold(
        1.5,
        "1",
        "times the best physical gain: such a function says the effect is unknown",
        "prototype study: effects outside the library called unknown 15 of 15",
    )

    # Naming: how much of what can be explained must be explained
    named: float = _threshold(
        0.9,
        "1",
        "share of the explainable error on training and veto, for a name",
        "prototype study: true effects reach 0.96, wrong ones at most 0.13",
    )
    named_with_rest: float = _threshold(
        0.95,
        "1",
        "the same where something that repeats is left beyond doubt",
        "reasoned: laws that resemble the true one leave a rest that repeats",
    )
    partly: float = _threshold(
        0.5,
        "1",
        "share below which nothing is said of an effect",
        "prototype study: wrong effects reach 0.13",
    )
    rest_errors: float = _threshold(
        3.0, "standard errors", "of the repeatable rest, to be beyond doubt", "one chance in a thousand"
    )
    rest_part: float = _threshold(
        0.03,
        "1",
        "of the noise: a smaller rest is none",
        "reasoned: the bias of the twin is known to some hundredths of the noise",
    )
    drift_z: float = _threshold(
        6.0,
        "standard errors",
        "of a friction level that differs between repeats",
        "second prototype study: thermal drift 12 of 12, no false alarm in 171",
    )
    drift_part: float = _threshold(
        0.1,
        "1",
        "of what differs between repeats: a smaller drift is none",
        "second prototype study, together with its z",
    )

    # A further effect beside those that are found
    worth_beside: float = _threshold(
        0.01,
        "1",
        "of what is explained: the least that a further effect must explain",
        "second prototype study: false second names explain less",
    )
    clear_beside: float = _threshold(
        0.1,
        "1",
        "of what is left: an effect that explains so much may be smaller",
        "reasoned: a weak effect beside a strong one",
    )
    worth_if_clear: float = _threshold(
        0.005, "1", "of what is explained: the least in that case", "reasoned: half of what else is asked"
    )
    chance_of_contact: float = _threshold(
        0.3,
        "1",
        "of what is left between two masses: what two fits of one model differ by",
        "bench.diagnosis: by a fifth two fits of one model differ by chance",
    )
    negligible: float = _threshold(
        0.02,
        "1",
        "of what is explained: an effect that is worth less is dropped",
        "second prototype study: what adds less than 0.02 on training and veto is dropped",
    )
    negligible_left: float = _threshold(
        0.05, "1", "of what is left: likewise, both must hold", "the same study; both must hold"
    )

    # Two fits of one model
    clearly_less: float = _threshold(
        0.8,
        "1",
        "of what was left: what another start must leave to be taken",
        "bench.diagnosis: by a fifth two fits of one model differ by chance",
    )

    # Spring or gap
    spring_instead: float = _threshold(
        1.2,
        "1",
        "of what a gap leaves: what a spring alone may leave to be preferred",
        "bench.diagnosis: by a fifth two fits of one model differ by chance",
    )
    spring_instead_beside: float = _threshold(
        1.1,
        "1",
        "the same beside other effects, or where it is plainly a gap",
        "reasoned: beside others, or plainly a gap, chance is half of that",
    )
    hardly_a_gap: float = _threshold(
        0.3,
        "1",
        "of the contact's twist at Coulomb friction: a smaller gap is none",
        "bench.diagnosis, seed 53009: a contact without gap took a spring's place",
    )

    # Verdict
    alike: float = _threshold(
        0.03,
        "1",
        "of the fall: rivals that come so near cannot be told apart",
        "reasoned: what repeats allow a fall to be known by",
    )
    alike_single: float = _threshold(
        0.1,
        "1",
        "the same from one trajectory",
        "study of measured data: in one file three effects tie within 0.02",
    )
    apart_z: float = _threshold(
        2.0,
        "standard errors",
        "by which the better of two models must err less, or a candidate over ranges of phase",
        "one chance in forty",
    )
    structure_errors: float = _threshold(
        2.5,
        "standard errors",
        "of the repeatable rest that says something is missing",
        "chance exceeds 1.5 in one of fifteen axes where nothing is missing, 2.5 in one of a hundred and sixty",
    )
    structure_part: float = _threshold(
        0.15,
        "1",
        "of the noise: the least such rest; so much of one experiment's an effect must explain",
        "the same runs",
    )
    line_part: float = _threshold(
        0.05,
        "1",
        "of the residual's variance: the least disturbance that follows the clock",
        "reasoned: a smaller line turns no verdict",
    )
    line_contrast: float = _threshold(
        60.0,
        "1",
        "times the median power: the least line",
        "reasoned: of ten thousand lines of noise the largest is thirteen times the median",
    )
    line_everywhere: float = _threshold(
        0.8,
        "1",
        "of the experiments that must hold it alike",
        "reasoned: a harmonic of one motion is in that experiment only",
    )
    rival_gain: float = _threshold(
        0.5,
        "1",
        "of the named effect's gain: an effect with less is no rival",
        "reasoned: what gains half as much does not confuse",
    )
    term_chance: float = _threshold(
        0.001,
        "1",
        "chance of a term that is not there to be kept (Wald)",
        "Wald's test; a dozen terms are looked at in a fit",
    )

    # Confirmation by another trajectory
    confirming_gain: float = _threshold(
        0.3,
        "1",
        "fall of the error there that counts whatever its scatter",
        "study of measured data: wrong effects raise the error on another trajectory",
    )
    confirming_margin: float = _threshold(
        0.1,
        "1",
        "by which an effect must err less there than its rivals, evenly",
        "reasoned: a tenth of the error, evenly over the trajectory",
    )
    lost: float = _threshold(
        10.0,
        "1",
        "times the mean square of the fit: where a model is so far off nothing is compared",
        "reasoned: models that are both far off tell nothing of each other",
    )

    # What one recording can show
    least_part: float = _threshold(
        0.007,
        "1",
        "of the torque's rms: a smaller effect is as often the measurement chain",
        "reasoned: what scaling, filters and rounding of others' files come to",
    )
    clear_single_gain: float = _threshold(
        0.5,
        "1",
        "gain of an effect that may be smaller",
        "reasoned: what explains half of the error everywhere is no accident",
    )
    clear_single_part: float = _threshold(
        0.002,
        "1",
        "of the torque's rms: the least of such an effect",
        "reasoned: the resolution of a measured current",
    )
    least_counts: float = _threshold(
        5.0,
        "counts",
        "of the encoder: shorter displacements and gaps cannot be seen",
        "reasoned: two roundings and the filter of a position",
    )
    least_warming: float = _threshold(
        5.0,
        "s",
        "the shortest time constant of a warming",
        "reasoned: within seconds it is the course of one move",
    )
    least_rests: int = _threshold(
        6, "rests", "for friction that grows with rest", "reasoned: twice as many as the law has parameters"
    )
    rest_ratio: float = _threshold(
        3.0, "1", "longest over shortest rest, at least", "reasoned: within less every start is alike"
    )
    beyond: float = _threshold(
        1.5,
        "1",
        "times the cut-off or what the sampling allows: what cannot be seen",
        "reasoned: half above a limit its flank is still seen",
    )
    large_rest: float = _threshold(
        0.03,
        "1",
        "of the torque: less may be left without a word",
        "reasoned: measurement chains of others leave some hundredths",
    )
    most_noise: float = _threshold(
        0.5,
        "1",
        "of the rest: what must be alike where the motion is alike to be structure",
        "study of measured data: nearest neighbours tell noise within a third",
    )

    # The model that everything is compared with
    twin_worse: float = _threshold(
        2.0,
        "1",
        "times the cost without twin: a twin that makes it worse is not used",
        "reasoned: it rings where the axis did not",
    )
    misfit: float = _threshold(
        0.8,
        "1",
        "of the torque's variance: a model that leaves more is of another axis",
        "reasoned: a wrong sign or unit leaves more",
    )
    fit_loose: float = _threshold(
        1.0,
        "1",
        "relative standard error from which inertia or friction is not known",
        "its interval of 95 % holds zero",
    )
    wrong_sign: float = _threshold(
        0.3,
        "1",
        "of the torque: what a negative inertia must come to, to be a wrong sign",
        "reasoned: chance gives a negative inertia next to nothing",
    )

    # The controller
    controller_explains: float = _threshold(
        0.999,
        "1",
        "share of the demand's variance: with less a controller drives no twin",
        "prototype study: gains wrong by a tenth do no harm, by three tenths they give false names",
    )
    controller_explains_in_band: float = _threshold(
        0.995,
        "1",
        "the same below the frequency that models are compared at, for a law that works between the samples",
        "24 worlds: laws of drives' own loops leave 0.0003 to 0.003 there with gains within a tenth; one of another "
        "kind 0.26",
    )
    controller_better: float = _threshold(
        0.1,
        "1",
        "of what a law leaves: what another must leave to be taken instead",
        "reasoned: a gain wrong by a tenth can still explain 0.999 where it does little",
    )
    answer_explains: float = _threshold(
        0.99,
        "1",
        "share of the torque that is linear in reference and position: just a controller's answer",
        "study of measured data",
    )
    reference_causes: float = _threshold(
        0.25,
        "1",
        "of the velocity's variance: the reference explains at least so much where it causes it",
        "reasoned: a reference that is followed explains nearly all of the speed",
    )
    answer_holds: float = _threshold(
        0.25,
        "1",
        "of the torque's rms: an answer to position comes to so much",
        "reasoned: a spring that the axis has carries a part of the torque only",
    )

    def no_chance(self, gain: float, z: float) -> bool:
        """Whether a gain on unseen experiments is in enough of them, or so large, that it is no chance."""
        return z >= self.least_z or gain >= self.clear_gain


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
