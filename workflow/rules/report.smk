# One HTML page of everything.


rule report:
    input:
        rules.outcomes.output.table,
        rules.runs.output.table,
        rules.trajectories.output,
        rules.flows.output.table,
        rules.assays.output.table,
        rules.calibration.output,
        rules.anova.output,
        rules.sensitivity.output,
        rules.robustness_map.output.table,
        rules.benchmark.output,
        rules.designs.output,
        rules.learning_curve.output,
        rules.search_regret.output,
        rules.verifications.output,
        rules.surrogate.output,
        made(rules.assay_study.output.table),
        made(rules.validation.output.table),
        made(rules.accuracy.output.table),
        made(rules.reference_check.output.table),
        made(rules.spot_check.output.table),
        made(rules.critical_gaps.output.convergence),
        made(rules.stability.output.table),
    output:
        f"{RESULTS}/report.html",
    params:
        settings=settings_of(
            "preset",
            "seed",
            "cell",
            "flow",
            "numerics",
            "run_control",
            "constriction",
            "assays",
            "default_assay",
            "design_requests",
        ),
    log:
        f"{RESULTS}/logs/report.log",
    benchmark:
        f"{RESULTS}/benchmarks/report.tsv"
    message:
        "write the report"
    script:
        "../scripts/report.py"
