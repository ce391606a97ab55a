# Empty-array flow per geometry, outcome per geometry and stiffness set, and their gathering.
# Priorities: what takes long and what waits for it first; short jobs then fill the cores at the end.


rule empty_flow:
    output:
        flow=ensure(f"{RESULTS}/flow/{{geometry}}.npz", non_empty=True),
        row=ensure(f"{RESULTS}/flow/{{geometry}}.flow.parquet", non_empty=True),
    params:
        settings=flow_settings,
        crashes=crash_count,
        crash_directory=CRASHES,
    log:
        f"{RESULTS}/logs/empty_flow/{{geometry}}.log",
    benchmark:
        f"{RESULTS}/benchmarks/empty_flow/{{geometry}}.tsv"
    priority: 1
    message:
        "flow without a cell through {wildcards.geometry}"
    script:
        "../scripts/empty_flow.py"


# Finished releases wait in the folder `partial`, which is no output: they are used after a stop.
rule simulate_outcome:
    input:
        unpack(flow_of_outcome),
    output:
        outcome=ensure(f"{RESULTS}/outcomes/{{outcome}}.outcome.parquet", non_empty=True),
        runs=ensure(f"{RESULTS}/outcomes/{{outcome}}.runs.parquet", non_empty=True),
        trajectory=ensure(f"{RESULTS}/outcomes/{{outcome}}.trajectory.parquet", non_empty=True),
    params:
        settings=outcome_settings,
        partial=f"{RESULTS}/partial/{{outcome}}",
        crashes=crash_count,
        crash_directory=CRASHES,
    log:
        f"{RESULTS}/logs/simulate_outcome/{{outcome}}.log",
    benchmark:
        f"{RESULTS}/benchmarks/simulate_outcome/{{outcome}}.tsv"
    priority: 1
    message:
        "cell through {wildcards.outcome}, released at as many places as it takes"
    script:
        "../scripts/simulate_outcome.py"


rule flows:
    input:
        expand(f"{RESULTS}/flow/{{geometry}}.flow.parquet", geometry=GEOMETRIES),
    output:
        table=f"{RESULTS}/flows.parquet",
        csv=f"{RESULTS}/flows.csv",
    params:
        kind="flows",
        settings=gathered(GEOMETRIES),
    log:
        f"{RESULTS}/logs/flows.log",
    benchmark:
        f"{RESULTS}/benchmarks/flows.tsv"
    message:
        "gather the flows of all geometries"
    script:
        "../scripts/gather.py"


rule trajectories:
    input:
        expand(f"{RESULTS}/outcomes/{{outcome}}.trajectory.parquet", outcome=OUTCOMES),
    output:
        f"{RESULTS}/trajectories.parquet",
    params:
        settings=gathered(OUTCOMES),
    log:
        f"{RESULTS}/logs/trajectories.log",
    benchmark:
        f"{RESULTS}/benchmarks/trajectories.tsv"
    message:
        "gather the trajectories of all runs"
    script:
        "../scripts/trajectories.py"


rule runs:
    input:
        expand(f"{RESULTS}/outcomes/{{outcome}}.runs.parquet", outcome=OUTCOMES),
    output:
        table=f"{RESULTS}/runs.parquet",
        csv=f"{RESULTS}/runs.csv",
    params:
        kind="runs",
        settings=gathered(OUTCOMES),
    log:
        f"{RESULTS}/logs/runs.log",
    benchmark:
        f"{RESULTS}/benchmarks/runs.tsv"
    message:
        "gather the runs of all outcomes"
    script:
        "../scripts/gather.py"


rule outcomes:
    input:
        rows=expand(f"{RESULTS}/outcomes/{{outcome}}.outcome.parquet", outcome=OUTCOMES),
        calibration=f"{RESULTS}/calibration.parquet",
    output:
        table=f"{RESULTS}/outcomes.parquet",
        csv=f"{RESULTS}/outcomes.csv",
    params:
        settings={
            **gathered(OUTCOMES, "run_control"),
            "sigma_num_model": uncertainty.models_hash(),
        },
    log:
        f"{RESULTS}/logs/outcomes.log",
    benchmark:
        f"{RESULTS}/benchmarks/outcomes.tsv"
    message:
        "gather all outcomes, join deformation indices and numerical uncertainty"
    script:
        "../scripts/outcomes.py"
