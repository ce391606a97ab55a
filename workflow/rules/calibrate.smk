# Constriction run per stiffness group and release position, and the calibration from them.


rule constrict:
    output:
        row=ensure(f"{RESULTS}/constriction/{{constriction}}.run.parquet", non_empty=True),
        trajectory=ensure(
            f"{RESULTS}/constriction/{{constriction}}.trajectory.parquet", non_empty=True
        ),
    params:
        settings=constriction_settings,
        crashes=crash_count,
        crash_directory=CRASHES,
    log:
        f"{RESULTS}/logs/constrict/{{constriction}}.log",
    benchmark:
        f"{RESULTS}/benchmarks/constrict/{{constriction}}.tsv"
    conda:
        "../envs/dldsim.yaml"
    message:
        "constriction run {wildcards.constriction}"
    script:
        "../scripts/constrict.py"


rule constriction_runs:
    input:
        expand(f"{RESULTS}/constriction/{{constriction}}.run.parquet", constriction=CONSTRICTIONS),
    output:
        table=f"{RESULTS}/constriction_runs.parquet",
        csv=f"{RESULTS}/constriction_runs.csv",
    params:
        kind="constriction_runs",
        settings=gathered(CONSTRICTIONS),
    log:
        f"{RESULTS}/logs/constriction_runs.log",
    benchmark:
        f"{RESULTS}/benchmarks/constriction_runs.tsv"
    conda:
        "../envs/dldsim.yaml"
    message:
        "gather the constriction runs"
    script:
        "../scripts/gather.py"


rule calibration:
    input:
        rules.constriction_runs.output.table,
    output:
        calibration=f"{RESULTS}/calibration.parquet",
        calibration_csv=f"{RESULTS}/calibration.csv",
        correlations=f"{RESULTS}/calibration_correlations.parquet",
        correlations_csv=f"{RESULTS}/calibration_correlations.csv",
    params:
        settings=settings_of(),
    log:
        f"{RESULTS}/logs/calibration.log",
    benchmark:
        f"{RESULTS}/benchmarks/calibration.tsv"
    conda:
        "../envs/dldsim.yaml"
    message:
        "calibrate the deformation index of each stiffness group"
    script:
        "../scripts/calibration.py"
