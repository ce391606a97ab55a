# Surrogate of the migration angle, and the geometries that separate two cell types best.


rule surrogate:
    input:
        rules.runs.output.table,
    output:
        model=f"{RESULTS}/surrogate.json",
        card=f"{RESULTS}/surrogate_card.json",
    params:
        settings=seeded(),
    log:
        f"{RESULTS}/logs/surrogate.log",
    benchmark:
        f"{RESULTS}/benchmarks/surrogate.tsv"
    message:
        "fit the surrogate of the migration angle"
    script:
        "../scripts/surrogate.py"


rule designs:
    input:
        model=rules.surrogate.output.model,
        card=rules.surrogate.output.card,
        calibration=rules.calibration.output.calibration,
    output:
        table=f"{RESULTS}/designs.parquet",
        csv=f"{RESULTS}/designs.csv",
        trials=f"{RESULTS}/design_trials.parquet",
        trials_csv=f"{RESULTS}/design_trials.csv",
    params:
        settings={
            **seeded("design_requests"),
            "safety_distance_um": CONFIG.sweep.safety_distance_um,
        },
    log:
        f"{RESULTS}/logs/designs.log",
    benchmark:
        f"{RESULTS}/benchmarks/designs.tsv"
    message:
        "search for designs"
    script:
        "../scripts/designs.py"


rule search_regret:
    input:
        model=rules.surrogate.output.model,
        card=rules.surrogate.output.card,
        calibration=rules.calibration.output.calibration,
    output:
        table=f"{RESULTS}/search_regret.parquet",
        csv=f"{RESULTS}/search_regret.csv",
    params:
        settings={
            **seeded("design_requests"),
            "safety_distance_um": CONFIG.sweep.safety_distance_um,
        },
    log:
        f"{RESULTS}/logs/search_regret.log",
    benchmark:
        f"{RESULTS}/benchmarks/search_regret.tsv"
    message:
        "compare the design search with random and exhaustive search"
    script:
        "../scripts/search_regret.py"
