# Empty-array flow per geometry, run per geometry and stiffness set, and their gathering.


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
    message:
        "flow without a cell through {wildcards.geometry}"
    script:
        "../scripts/empty_flow.py"


rule simulate_run:
    input:
        unpack(flow_of_run),
    output:
        row=ensure(f"{RESULTS}/runs/{{run}}.run.parquet", non_empty=True),
        trajectory=ensure(f"{RESULTS}/runs/{{run}}.trajectory.parquet", non_empty=True),
    params:
        settings=run_settings,
        crashes=crash_count,
        crash_directory=CRASHES,
    log:
        f"{RESULTS}/logs/simulate_run/{{run}}.log",
    benchmark:
        f"{RESULTS}/benchmarks/simulate_run/{{run}}.tsv"
    message:
        "cell run {wildcards.run}"
    script:
        "../scripts/simulate_run.py"


rule flows:
    input:
        expand(f"{RESULTS}/flow/{{geometry}}.flow.parquet", geometry=GEOMETRIES),
    output:
        table=f"{RESULTS}/flows.parquet",
        csv=f"{RESULTS}/flows.csv",
    params:
        kind="flows",
        settings=settings_of(),
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
        expand(f"{RESULTS}/runs/{{run}}.trajectory.parquet", run=RUNS),
    output:
        f"{RESULTS}/trajectories.parquet",
    params:
        settings=settings_of(),
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
        rows=expand(f"{RESULTS}/runs/{{run}}.run.parquet", run=RUNS),
        calibration=f"{RESULTS}/calibration.parquet",
    output:
        table=f"{RESULTS}/runs.parquet",
        csv=f"{RESULTS}/runs.csv",
    params:
        settings={**settings_of("run_control"), "sigma_num_model": accuracy.model_hash()},
    log:
        f"{RESULTS}/logs/runs.log",
    benchmark:
        f"{RESULTS}/benchmarks/runs.tsv"
    message:
        "gather all runs and join the deformation indices"
    script:
        "../scripts/runs.py"
