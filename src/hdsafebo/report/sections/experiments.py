"""Sections of the tasks: synthetic functions, stimulation, digits, and the ablations."""

from __future__ import annotations

import numpy as np
import pandas as pd

from hdsafebo.report.claims.hand import beta_methods
from hdsafebo.report.data.inputs import Inputs
from hdsafebo.report.data.methods import style, task_label
from hdsafebo.report.data.results import POOLS, Results
from hdsafebo.report.figures.ablation import beta_figure
from hdsafebo.report.figures.curves import curve_figures, final_figure, single_curve_figure
from hdsafebo.report.figures.inputs import field_map_figure, selectivity_figure
from hdsafebo.report.formatting import number
from hdsafebo.report.sections.base import Block, Details, Section, Text, not_run
from hdsafebo.report.sections.findings import (
    closed_form_finding,
    given_blocks,
    leader_findings,
    paper_findings,
    ratio_finding,
    regret_finding,
    same_trials_findings,
    size_sentence,
)
from hdsafebo.report.stats.regret import regret
from hdsafebo.report.tables.results import comparison_table, metrics_table, unconstrained_table
from hdsafebo.report.tables.speed import regret_table

RANDOM_EMBEDDINGS = ("hesbo", "baxus")
ABLATION = ("hdsafebo", "hdsafebo_global", "hdsafebo_pessimistic")


def compared(results: Results, task: str) -> list[str]:
    """Methods of a task without the ablations, which have their own section."""
    return [m for m in results.methods(task) if style(m).family != "ablation"]


def task_blocks(results: Results, task: str) -> list[Block]:
    """Size, findings, final values, curves and comparisons of one task."""
    methods = compared(results, task)
    if not methods:
        return [not_run(task_label(task))]
    caption = (
        "Mean ± standard error over runs; the paper's numbers in small type. Bold: significantly better "
        "than every other method of the table."
    )
    pairs = comparison_table(results, task, methods)  # none, where one method alone has run
    return [
        size_sentence(results, task, methods),
        *given_blocks(results, task, methods),
        *leader_findings(results, task, methods),
        *paper_findings(results, task),
        final_figure(results, task, methods),
        metrics_table(results, task, methods, f"{task_label(task)}. {caption}", f"metrics_{task}"),
        *curve_figures(results, task, methods),
        *([Details("Paired comparisons", pairs)] if pairs.rows else []),
    ]


def synthetic_section(results: Results) -> Section:
    """Table 1 and the table of latent against original space."""
    intro = Text(
        "Objective and safety are samples of Gaussian processes over 40 of 50 latent coordinates inside "
        "1,000 inputs. (O) marks methods that search the original inputs; the others search the 50 "
        "principal components. The samples are drawn as they are evaluated, from the same random numbers "
        "for every method of a seed: methods whose trials all lie many length scales apart meet the same "
        "white noise, and their rows are equal."
    )
    check = closed_form_finding(results)
    blocks = [intro, *task_blocks(results, "synthetic"), *([] if check is None else [check])]
    return Section("synthetic", "Synthetic functions", "Table 1, appendix C.1", blocks)


def ablation_section(results: Results) -> Section:
    """Components of HdSafeBO and its beta, on every task on which they were run."""
    blocks: list[Block] = []
    for task in results.experiments:
        ran = results.methods(task)
        components = [m for m in ABLATION if m in ran]
        betas = beta_methods(results, task)
        shown = list(dict.fromkeys([*components, *betas.values()]))
        if len(shown) < 2:
            continue
        blocks += [size_sentence(results, task, shown), *leader_findings(results, task, shown)]
        blocks += same_trials_findings(results, task, shown)
        if len(components) > 1:
            caption = (
                f"{task_label(task)}: HdSafeBO without local search and without "
                "optimism. Bands are one standard error."
            )
            blocks.append(single_curve_figure(results, task, components, f"components_{task}", caption))
        if len(betas) > 1:
            blocks.append(beta_figure(results, task, betas))
        blocks.append(
            metrics_table(results, task, shown, f"{task_label(task)}, ablations.", f"ablation_{task}")
        )
    return Section("ablation", "Ablations", "Appendices C.2 and C.4", blocks or [not_run("Ablations")])


def stimulation_section(results: Results, inputs: Inputs) -> Section:
    """Figure 4, the selectivity distributions, the field map, regret, and the random embeddings."""
    blocks: list[Block] = [
        Text(
            "Sixteen contacts and a current; objective: selectivity of one muscle group; safety: g = 1 − "
            "the largest activation of any group. "
            "Only the traversed parameters can be evaluated, so the best safe value is known."
        )
    ]
    if inputs.stimulation is None:
        blocks.append(not_run("Traversal of the stimulation parameters"))
    else:
        s = inputs.stimulation
        share = f"{100 * s.safe_share:.1f} % are safe (g ≥ {s.threshold:g})"
        blocks += [
            Text(f"The traversal has {s.rows:,} parameters; {share}.", "finding"),
            selectivity_figure(s),
        ]
    blocks += inputs.spinal_frames
    if inputs.stimulation is not None and (example := inputs.stimulation.example) is not None:
        blocks.append(field_map_figure(np.array(example.pixels), example.title))
    tasks = [task for task in results.tasks if task.startswith("scs_")]
    for task in tasks or ["scs_st", "scs_ga"]:
        blocks.append(Text(task_label(task), "heading"))
        blocks += task_blocks(results, task)
        blocks += _regret_blocks(results, task)
    blocks += _random_embedding_blocks(results, tasks)
    return Section(
        "stimulation",
        "Stimulation of the spinal cord",
        "Section 5.3, Figure 4, appendices B.6 and C.5",
        blocks,
    )


def _random_embedding_blocks(results: Results, tasks: list[str]) -> list[Block]:
    """The paper's comparison with methods that search a random embedding and know no safety."""
    blocks: list[Block] = [Text("Random embeddings (appendix C.5)", "heading")]
    for task in tasks:
        ran = results.methods(task)
        if any(method in ran for method in RANDOM_EMBEDDINGS):
            shown = [m for m in ran if style(m).family != "ablation"]
            caption = (
                f"{task_label(task)}: best value of a run, safe or not, as the paper's table has it for "
                "HesBO and BAxUS, which search without regard to safety."
            )
            blocks.append(unconstrained_table(results, task, shown, caption))
    return blocks if len(blocks) > 1 else [*blocks, not_run("HesBO and BAxUS")]


def _regret_blocks(results: Results, task: str) -> list[Block]:
    optimum = results.optimum(task)
    shares: dict[str, pd.DataFrame] = {}
    for method in compared(results, task):
        table = regret(results.runs[task, method], results.series(task, method))
        if table is not None:
            shares[method] = table
    if optimum is None or not shares:
        return []
    caption = (
        f"{task_label(task)}: best safe value found as a share of the best safe value of the whole set "
        f"({number(optimum)}), and the median number of trials, initial ones included, until 95 % of it."
    )
    return [regret_finding(task, shares), regret_table(task, shares, optimum, caption)]


def digits_section(results: Results) -> Section:
    """The digits, averaged, and each digit in a folded table."""
    intro = Text(
        "Make a digit as thick as possible while a network still recognises it. The objective is "
        "normalised by the best recognised image of the data set. A code has the values of the image that it "
        "decodes to, so the initial trials, too, are images as the embedding shows them. "
        "Values are means over seeds for each digit, then mean ± standard error over digits; the paper "
        "prints standard deviations over digits."
    )
    blocks: list[Block] = [intro]
    for pool in POOLS:
        if pool in results.experiments or pool == POOLS[0]:
            blocks += [Text(task_label(pool), "heading"), *task_blocks(results, pool)]
            ratio = ratio_finding(results, pool)
            blocks += [] if ratio is None else [ratio]
    for task in results.digit_tasks:
        table = metrics_table(
            results, task, compared(results, task), f"{task_label(task)}.", f"metrics_{task}"
        )
        blocks.append(Details(task_label(task), table))
    return Section("digits", "Digits", "Appendix C.6", blocks)
