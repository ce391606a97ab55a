# Error against run time; not part of the campaign.


rule accuracy_run:
    output:
        row=ensure(f"{RESULTS}/accuracy/{{variant}}.run.parquet", non_empty=True),
    params:
        settings=accuracy_settings,
        crashes=crash_count,
        crash_directory=CRASHES,
    log:
        f"{RESULTS}/logs/accuracy_run/{{variant}}.log",
    benchmark:
        f"{RESULTS}/benchmarks/accuracy_run/{{variant}}.tsv"
    message:
        "accuracy run {wildcards.variant}"
    script:
        "../scripts/accuracy_run.py"


rule accuracy:
    input:
        rows=expand(f"{RESULTS}/accuracy/{{variant}}.run.parquet", variant=VARIANTS),
    output:
        table=f"{RESULTS}/accuracy.parquet",
        csv=f"{RESULTS}/accuracy.csv",
    params:
        variants=VARIANTS,
        settings=gathered(VARIANTS, "accuracy", "cell", "constriction", "numerics", "run_control"),
    log:
        f"{RESULTS}/logs/accuracy.log",
    benchmark:
        f"{RESULTS}/benchmarks/accuracy.tsv"
    message:
        "compare the accuracy runs"
    script:
        "../scripts/accuracy.py"
