"""Section of the hand: the task and how hard it is, who does it, what the best policies look like."""

from __future__ import annotations

from hdsafebo.report.data.hand_inputs import TASKS, HandInputs, Policies, Policy, StoredDifficulty
from hdsafebo.report.data.inputs import Inputs, StoredPicture
from hdsafebo.report.data.methods import style, task_label
from hdsafebo.report.data.results import Results
from hdsafebo.report.figures.curves import front_figure
from hdsafebo.report.figures.inputs import learning_figure, synergy_figure
from hdsafebo.report.formatting import number
from hdsafebo.report.sections.base import Block, Section, Text, not_run
from hdsafebo.report.sections.experiments import compared, task_blocks
from hdsafebo.report.tables.hand import upright, upright_finding, upright_table

_INTRO = Text(
    "A linear policy turns observations into muscle synergies; the bottle is to be rotated to vertical and "
    "held. Objective: return of an episode. Safety: the landing speed of the bottle. Initial policies are "
    "random policies over synergies without those that end upright, the same ones for all methods."
)
_MODELLED = Text(
    "What is modelled, and why: a held bottle ends at about 0 m/s and a dropped one at 4.1 to 4.5 m/s, so "
    "the landing speed is nearly binary, and the paper's threshold of 4.4 m/s lies within the drops, where "
    "the speed says little about the policy. All tables report this safety. In the paper's setting every "
    "method models it. In the informed setting every method models no_drop in its place: 1 for a bottle "
    "held to the end, else minus the share of the episode that was left. Its threshold lies between the two "
    "modes, below it no_drop tells how early the bottle fell, and a policy that never drops the bottle "
    "meets the landing speed as well. Which functions are modelled is set in params.yaml (tasks.hand)."
)
_CHOSEN = Text(
    "How hard the task is was chosen, and this is how: friction of the bottle (that of MyoHand's skin), roll "
    "of the upper arm (how far the forearm must pronate), limit of the weights over synergies and the zero "
    "policy (it keeps the activations of the start pose) were set by what random policies do, so that about "
    "a third drop the bottle, returns spread over hundreds and few end upright. The choice was not blind: "
    "walks of 300 Gaussian steps, on other random numbers than those of the runs shown here, were looked at "
    "as well, and earlier settings, on which optimisers had run (less roll, the mean activation of the "
    "training as zero policy), were given up because random policies or the zero policy came too close to "
    "doing the task. The basis of synergies follows a fixed rule: components by falling variance, each with "
    "its largest loading positive.",
    "caution",
)


def hand_section(results: Results, inputs: Inputs) -> Section:
    """Figure 3, the best policies, the synergies and the training behind them."""
    blocks: list[Block] = [
        _INTRO,
        *_difficulty(inputs.hand.difficulty),
        _MODELLED,
        *inputs.hand_frames,
    ]
    for task in [t for t in results.tasks if t in TASKS] or ["hand"]:
        blocks += [Text(task_label(task), "heading"), *task_blocks(results, task)]
        blocks += [front_figure(results, task, compared(results, task))] if task in results.tasks else []
        blocks += _upright(results, task, inputs.hand)
    blocks += _policies(inputs.hand)
    variance = inputs.variance
    blocks.append(not_run("Muscle synergies") if variance is None else synergy_figure(variance))
    curve = inputs.learning_curve
    blocks.append(not_run("Training of the policy") if curve is None else learning_figure(curve))
    return Section("hand", "Musculoskeletal hand", "Section 5.2, Figure 3", blocks)


def _difficulty(found: StoredDifficulty | None) -> list[Block]:
    """How hard the task is, and how that came about."""
    if found is None:
        return [_CHOSEN, not_run("Random policies")]
    low, _, median, _, high = found.return_quantiles
    zero = "ends upright" if found.zero_policy_upright else "does not end upright"
    share = Text(
        f"Of {found.policies} random policies {100 * found.dropped:.0f} % drop the bottle, "
        f"{100 * found.safe:.0f} % are safe at {found.landing_limit:g} m/s and {100 * found.upright:.1f} % "
        f"end upright; returns: {number(low)} to {number(high)}, median {number(median)}. The zero policy "
        f"{zero} (tilt {number(found.zero_policy_tilt)} rad).",
        "finding",
    )
    return [_CHOSEN, share]


def _upright(results: Results, task: str, hand: HandInputs) -> list[Block]:
    """Who ends upright; names the methods whose run files do not tell."""
    methods = compared(results, task)
    known = {m: rows for m in methods if (rows := hand.outcomes.get((task, m))) is not None}
    blocks: list[Block] = []
    if known:
        found = [upright(method, rows) for method, rows in known.items()]
        blocks += [Text(upright_finding(found), "finding"), upright_table(task, found)]
    if silent := [style(method).label for method in methods if method not in known]:
        blocks.append(
            Text(f"Whether policies end upright: not in the run files of {', '.join(silent)}.", "missing")
        )
    return blocks


def _policies(hand: HandInputs) -> list[Block]:
    """Pictures of the best policies, one strip each, or what is missing to draw them."""
    shown = hand.policies
    if shown is None or not shown.policies:
        return [not_run("Pictures of the best policies")]
    times = ", ".join(f"{t:g}" for t in shown.frames_at_s)
    head = Text(
        "Best safe policies of HdSafeBO, HdSafeBO-local and the best of the other methods (by mean return), "
        f"played again from the run files; pictures at {times} s.",
        "heading",
    )
    if shown.missing is not None:
        return [head, Text(f"No pictures: {shown.missing}.", "missing"), *_words(shown)]
    return [
        head,
        *(
            StoredPicture(_what(policy), hand.strips[policy.picture])
            for policy in shown.policies
            if policy.picture
        ),
    ]


def _words(shown: Policies) -> list[Text]:
    return [Text(_what(policy)) for policy in shown.policies]


def _what(policy: Policy) -> str:
    """What a policy did, in words."""
    head = f"{style(policy.method).label}, seed {policy.seed}: return {number(policy.objective)}"
    if policy.replayed is None or policy.tilt is None:
        return f"{head}; played again, the simulation failed: {policy.failure}"
    again = (
        "" if abs(policy.replayed - policy.objective) < 1 else f" (played again {number(policy.replayed)})"
    )
    end = "dropped" if policy.dropped else "upright" if policy.upright else "held, not upright"
    return f"{head}{again}; {end}, tilt at the end {number(policy.tilt)} rad"
