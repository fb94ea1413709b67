"""Rows of chapters 2 to 4, and of what chapter 6 proposes, in the table of docs/reproduction.md."""

import math

from reproduction_rows import Row, band, data, percent, reproduced, summary
from scipy import stats

from optim.experiments.data import Kind
from optim.experiments.tables import select
from optim.studies.chapter3.sensor_placement import correlation_of_metrics
from optim.studies.chapter3.sweep_table import SweepTable, read_sweep_table
from optim.studies.chapter4.training import metric_correlations, read_training_table

ROBOTS = ("legged", "wheeled", "whegged")


def interference() -> list[Row]:
    """M1 to M4 with two and four lights, tests, and each light alone."""
    kinds: dict[str, Kind] = {**dict.fromkeys(("definition", "measure", "fitness", "robot"), str), "runs": int}
    kinds |= {**dict.fromkeys(("mean", "low", "high"), float), "published": float | None}
    means = {
        n: select(data("interference", n).records("tables.csv", kinds), definition="defined") for n in ("two", "four")
    }
    runs = {n: means[n][0]["runs"] for n in means}
    order = "morpholab interference --runs 5 --generations 400"
    orders = {"two": order, "four": f"{order} --environments 4 --precision f32"}
    share = {n: f"{percent(runs[n] * 400 / (30 * 3000))}: {runs[n]} of 30 runs, 400 of 3000 generations" for n in means}
    why = {
        ("two", "sum"): "legged and whegged robots end nearer: what specialises late costs M1 late",
        (
            "two",
            "product",
        ): "wheeled and whegged robots still come nearer after a seventh of the generations; same order",
        ("two", "min"): "all three still come nearer after a seventh of the generations; same order",
        ("four", "sum"): "smaller in all, as nobody has specialised in so few generations",
        (
            "four",
            "product",
        ): "legged robots are not behind wheeled ones: in the mean neither comes a metre nearer than it starts",
        ("four", "min"): "legged and wheeled robots are level: in the mean neither comes a metre nearer than it starts",
    }
    rows = []
    for (lights, fitness), differs in why.items():
        own = [select(means[lights], measure="M1", fitness=fitness, robot=robot)[0] for robot in ROBOTS]
        what = f"M1 [m] by {fitness}, {lights} lights: {', '.join(ROBOTS)}"
        published, here = ", ".join(f"{row['published']:.2f}" for row in own), ", ".join(band(row, 2) for row in own)
        rows.append(
            Row(what, published, here, f"{runs[lights]} runs", share[lights], orders[lights], "0 to 4", differs)
        )
    rows += _at_3000_generations(kinds)
    others = [row for row in means["two"] if row["measure"] != "M1"]
    inside = sum(row["low"] <= row["published"] <= row["high"] for row in others)
    what, here = "M2, M3, M4, two lights: published means in our intervals", f"{inside} of {len(others)}"
    differs = "five runs make wide intervals; [which lie outside](quadrupeds-measured.md#two-environments)"
    rows.append(Row(what, "27 means", here, f"{runs['two']} runs", share["two"], order, "0 to 4", differs))
    names: dict[str, Kind] = dict.fromkeys(("definition", "measure", "first", "second"), str)
    tests = data("interference", "two").records("tests.csv", names)
    (pair,) = select(tests, definition="defined", measure="M1", first="min legged", second="min whegged")
    here = f"p = {pair['p']:.3f}, {pair['p_bonferroni']:.2f} after Bonferroni; A12 = {pair['A12']:.2g}"
    differs = f"{sum(t['p_bonferroni'] < 0.05 for t in tests)} of {len(tests)} tests survive: with five runs none can"
    what = "whegged nearer than legged robots, by min, two lights"
    rows.append(Row(what, "significant", here, "5, 5 runs", share["two"], order, "0 to 4", differs))
    return rows + _alone()


def _at_3000_generations(kinds: dict[str, Kind]) -> list[Row]:
    """All four measures of the treatments that have run for the published generations, with Student's intervals."""
    found = data("interference", "at-3000").records("tables.csv", {**kinds, "deviation": float})
    rows = []
    for fitness, robot in dict.fromkeys((row["fitness"], row["robot"]) for row in found):
        own = select(found, definition="defined", fitness=fitness, robot=robot)
        runs, bands, within = own[0]["runs"], [], 0
        for row in own:
            half = stats.t.ppf(0.975, runs - 1) * row["deviation"] / math.sqrt(runs)
            low, high = row["mean"] - half, row["mean"] + half
            within += low <= row["published"] <= high
            bands.append(band({**row, "low": low, "high": high}, 2))
        what = f"M1 [m], M2 [degrees], M3 [m], M4 [%] by {fitness}, two lights, {robot}"
        published = ", ".join(f"{row['published']:.2f}" for row in own)
        share = f"{percent(runs / 30)}: {runs} of 30 runs, all 3000 generations"
        command = f"morpholab interference --robots {robot} --fitness {fitness} --runs {runs} --generations 3000"
        differs = (
            "nothing: all are in our intervals (Student's t)" if within == len(own) else f"{within} of 4 are inside"
        )
        rows.append(Row(what, published, ", ".join(bands), f"{runs} runs", share, command, f"0 to {runs - 1}", differs))
    return rows


def _alone() -> list[Row]:
    rows, few = list[Row](), "morpholab interference --alone --runs 5 --precision f32"
    alone = data("interference").records("alone.csv", {"robot": str, "distance": float, "generations": int})
    for robot in ROBOTS:
        every = select(alone, robot=robot)
        generations = max(row["generations"] for row in every)
        own = select(every, generations=generations)
        near = sum(row["distance"] <= 0.5 for row in own)
        differs = "slow: it still comes nearer" if near < len(own) else "nothing"
        command = f"{few} --robots {robot} --generations {generations}"
        what = f"{robot} robots that reach a light that is the only one"
        rows.append(
            Row(what, "all", f"{near} of {len(own)}", f"{len(own)} runs", "not published", command, "0 to 4", differs)
        )
    return rows


def _solving(sweep: SweepTable, design: int) -> tuple[int, int]:
    own = sweep.rows([design])
    return int(own.solving_all[0]), int(own.solving_any[0])


def placement() -> list[Row]:
    """The theoretical vehicle of chapter 3, whose radius of success is 0.2 m."""
    sweep = read_sweep_table(data().path("vehicle-sweep-radius-0.2.csv"))
    order = "morpholab sweep --designs all --radius 0.2 --time-step 0.1 --steps 5000"
    fixed = {
        "n": f"{sweep.settings.weights**2} controllers",
        "share": "100 %",
        "command": order,
        "seeds": "none: a grid",
    }
    every, some = _solving(sweep, 6553)
    best = sweep.learnability.max()
    designs = " and ".join(map(str, sweep.designs[sweep.learnability == best]))
    one = int((sweep.resistance == 1).sum())
    bodies = f"{len(sweep.designs)} bodies"
    settings = "[settings](vehicle-measured.md#the-settings-of-the-texts)"
    text = f"at 500 s in all; at 10,000 s, which the text states, 2504 ({settings})"
    return [
        Row("controllers of the canonical body that solve all", "57", str(every), differs=text, **fixed),
        Row(
            "its M_L, M_CF",
            "0.049, 0.24",
            f"{every / 14641:.4f}, {every / some:.4f}",
            differs="the text's own 57 controllers are an M_L of 0.0039",
            **fixed,
        ),
        Row(
            "controllers of design 241, the published best",
            "2255",
            str(_solving(sweep, 241)[0]),
            differs="steps of 0.1 s jump over the light: 2245 with 0.0005 s, "
            "[see the settings](vehicle-measured.md#the-settings-of-the-texts)",
            **fixed,
        ),
        Row(
            "largest M_L",
            "0.286",
            f"{best:.4f}, designs {designs}",
            differs="0.286 is 4187 controllers, more than the text's own 2255",
            **fixed | {"n": bodies},
        ),
        Row(
            "M_CF = 1",
            "several bodies",
            f"{one} bodies, largest {sweep.resistance.max():.4f}",
            differs="not explained",
            **fixed | {"n": bodies},
        ),
    ]


def rover() -> list[Row]:
    """The rigid vehicle of chapter 3."""
    kinds: dict[str, Kind] = {"body": str, "model": str, **dict.fromkeys(("controllers", "solving_4"), int)}
    success = data("rover-success").records("rover-success.csv", kinds | dict.fromkeys(("M_L", "M_CF"), float))
    rows = []
    for body, published, differs in (
        ("canonical", "1, 0.000068, 0.00052", "nothing"),
        ("best", "57, 0.0039, 0.038", "one controller: contact is another solver's"),
    ):
        (own,) = select(success, body=body, model="rigid bodies")
        here = f"{own['solving_4']}, {own['M_L']:.2g}, {own['M_CF']:.2g}"
        what, n = f"rover, {body} body: controllers that solve all, M_L, M_CF", f"{own['controllers']} controllers"
        rows.append(Row(what, published, here, n, "100 %", reproduced("rover-success"), "none: a grid", differs))
    found = summary("rover-sweep")
    bodies, weights = found["bodies"], found["weights"]
    share = f"{percent(bodies * weights**2 / (6561 * 14641))}: {bodies} of 6561 bodies, {weights}² of 121² weights"
    above = {
        metric: round(found[f"{metric}, rigid bodies"]["known_bodies"]["best"]["share_of_bodies_above"] * bodies)
        for metric in ("M_L", "M_CF")
    }
    rows.append(
        Row(
            "rover: bodies above the published best, by M_L, by M_CF",
            "0, 0",
            f"{above['M_L']}, {above['M_CF']}",
            f"{bodies} bodies",
            share,
            reproduced("rover-sweep", "medium"),
            str(found["seed"]),
            "coarse weights: one controller is 0.001 of M_L",
        )
    )
    base = summary("rover-pre-optimisation")
    published, own = base["published_base"], base["unit"]["base"]
    rows.append(
        Row(
            "rover's base: torque + speed + rate [pi], with all four lights",
            f"{published['effort']:.3f}",
            f"{own['effort']:.3f}",
            "3 searches, 8,000 evaluations each",
            "100 %",
            reproduced("rover-pre-optimisation"),
            "1 to 3",
            "the least of three; masses differ, as they decide little "
            "([the base body](rover-measured.md#the-base-body))",
        )
    )
    return rows


def metrics() -> list[Row]:
    """The sweep of chapter 4, and whether its metrics foretell training."""
    path = data().path("vehicle-sweep.csv")
    sweep, runs = read_sweep_table(path), read_training_table(data().path("vehicle-training-all.csv"))
    every, some = _solving(sweep, 6553)
    order, bodies = "morpholab sweep --designs all", f"{len(sweep.designs)} bodies"
    fixed = {"share": "100 %", "command": order, "seeds": "none: a grid"}
    both = correlation_of_metrics(sweep)
    texts = "the text is of other settings ([which](vehicle-measured.md#the-settings-of-the-texts)): there it is"
    wide = read_sweep_table(data().path("vehicle-sweep-radius-0.2.csv"))
    rows = [
        Row(
            "baseline: M_L, M_CI",
            "0.0018, 0.0142",
            f"{every / 14641:.4f}, {every / some:.4f}",
            n=f"{sweep.settings.weights**2} controllers",
            differs="nothing: steps of 0.05 s, 10,000 of them, where the text has 0.1 s and 100,000",
            **fixed,
        )
    ]
    for name, published in {"M_L": 0.1206, "M_CI": 0.6479}.items():
        here, there = sweep.metrics[name].max(), wide.metrics[name].max()
        differs = f"{texts} {there:.4f}"
        rows.append(Row(f"largest {name}", f"{published}", f"{here:.4f}", n=bodies, differs=differs, **fixed))
    told = f"r = {band(vars(both), 3, 'r')}"
    rows.append(Row("M_L with M_CI", "positive, p < 0.001", told, n=bodies, differs="nothing", **fixed))
    names = {
        "random": "random search",
        "generating-set": "generating set search",
        "nes": "NES",
        "de": "differential evolution",
    }
    for found in metric_correlations(runs, sweep):
        if found.over == "bodies":
            what = f"evaluations of {names.get(found.method, found.method)} with {found.metric}"
            n = f"{found.found.n} bodies, {runs.evaluations.shape[2]} runs each"
            here = f"r = {band(vars(found.found), 3, 'r')}"
            rows.append(
                Row(what, "negative, p < 0.001", here, n, "100 %", "morpholab train --designs all", "1", "nothing")
            )
    return rows + _co_optimisation()


def _co_optimisation() -> list[Row]:
    found = summary("co-optimisation")
    times = {arm: each["any_point"] for arm, each in found["evaluations_until_all_solved"].items()}
    fixed = {"share": "100 %", "command": reproduced("co-optimisation"), "seeds": "1 to 30"}
    test = found["tests_of_evaluations_until_all_solved"][0]
    low, high = test["interval"]
    both, base = times["co_optimised"], times["baseline"]
    course = found["homeostasis"]["course"]["co_optimised"]["normalised"]
    fell, settled = course["all"], course["solved"]["p_wilcoxon_two_sided"]
    medians = f"medians {both['median']:g}, {base['median']:g}"
    by = f"by {test['difference']:.1f} [{low:.1f}, {high:.1f}] on average"
    change = f"normalised, medians {fell['median_first']:.3f} to {fell['median_last']:.3f}"
    told = f"{change}, in {fell['fell']} of {fell['trials']} runs, p = {fell['p_wilcoxon_two_sided']:.2f}"
    alike = f"among solutions that solve all it does not (p = {settled:.2f}): it is the fall from failing to succeeding"
    return [
        Row(
            "co-optimisation: fewer evaluations than for the baseline's weights",
            "p < 0.001",
            f"{medians}; {by}; p = {test['p']:.4f}",
            n="30, 30 runs",
            differs="smaller effect: here the baseline does solve all",
            **fixed,
        ),
        Row(
            "runs of the baseline that solve all four",
            "none",
            f"{base['solved']} of {base['trials']}",
            n=f"{base['trials']} runs",
            differs="not explained; 0.1 % of its random weights do",
            **fixed,
        ),
        Row(
            "distance of signals (DTW) falls in the course of co-optimisation",
            "it falls",
            told,
            n=f"{fell['trials']} runs",
            differs=alike,
            **fixed,
        ),
    ]


def proposals() -> list[Row]:
    """What chapters 4 and 6 propose, and publish no number of."""
    bodies, objective, gap = (
        summary(name) for name in ("homeostasis-of-bodies", "homeostasis-objective", "reality-gap")
    )
    rank = bodies["correlations"]["raw with M_L"]["spearman"]
    (test,) = [t for t in objective["tests"]["M_L"] if (t["first"], t["second"]) == ("with", "without")]
    low, high = test["interval"]
    rows = [
        Row(
            "DTW distance of a body with its M_L",
            "proposed, no value",
            f"Spearman's r = {band(rank, 2, 'r')}",
            f"{rank['n']} bodies",
            "not published",
            reproduced("homeostasis-of-bodies"),
            "1",
            "it goes along with the metric, and cannot stand in for it",
        ),
        Row(
            "M_L of what is found without DTW as an objective, less that with it",
            "proposed, no value",
            f"{test['difference']:.3f} [{low:.3f}, {high:.3f}], p = {test['p']:.2f}",
            "30, 30 runs",
            "not published",
            reproduced("homeostasis-objective"),
            "1 to 30",
            "signals become alike, learnability stays",
        ),
    ]
    tests = {str(each["second"]): each for each in gap["tests"]}
    for design, name in {"162": "best body", "5841": "body 5841"}.items():
        test, mean = tests[design], gap["mean_over_perturbations"]
        low, high = test["interval"]
        by = f"by {test['difference']:.2f} [{low:.2f}, {high:.2f}]"
        here = f"{mean[design]['mean']:.2f}, {mean['6553']['mean']:.2f}; {by}"
        n = f"{mean[design]['controllers']}, {mean['6553']['controllers']} controllers"
        what = f"reality gap: controllers that survive changes, {name}, baseline"
        rows.append(
            Row(what, "more, expected", here, n, "not published", reproduced("reality-gap"), "1", "as expected")
        )
    for what, told in {
        "kept": "share of the weight manifold that still solves all",
        "size": "size of the manifold for what it was",
        "shift": "shift of its mean",
    }.items():
        each = {name: gap["manifolds"][design] for design, name in (("162", "best body"), ("6553", "baseline"))}
        here = ", ".join(f"{name} {band(found[what], 3 if what == 'shift' else 2)}" for name, found in each.items())
        sizes = " and ".join(str(found["controllers"]) for found in each.values())
        n = f"{each['best body'][what]['n']} kinds, {each['best body']['changes']} changes; {sizes} controllers"
        differs = {
            "kept": "as expected, but intervals touch: what is left of the baseline's depends on the kind of change",
            "size": "the small one gains more than it loses, the large one less",
            "shift": "as expected: the small one moves further, in the plane of both weights",
        }[what]
        rows.append(
            Row(
                f"reality gap: {told}",
                "expected, no value",
                here,
                n,
                "not published",
                reproduced("reality-gap"),
                "1",
                differs,
            )
        )
    return rows
