# Validation cases beside reference values; not part of the campaign, see
# dldsim/evidence/validation.py.


rule validate_case:
    output:
        table=ensure(f"{RESULTS}/validation/{{case}}.parquet", non_empty=True),
    params:
        settings=settings_of(),
        crashes=crash_count,
        crash_directory=CRASHES,
    log:
        f"{RESULTS}/logs/validate_case/{{case}}.log",
    benchmark:
        f"{RESULTS}/benchmarks/validate_case/{{case}}.tsv"
    message:
        "validation case {wildcards.case}"
    script:
        "../scripts/validate_case.py"


rule validation:
    input:
        expand(f"{RESULTS}/validation/{{case}}.parquet", case=CASES),
    output:
        table=f"{RESULTS}/validation.parquet",
        csv=f"{RESULTS}/validation.csv",
    params:
        kind="validation",
        settings=gathered([*CASES]),
    log:
        f"{RESULTS}/logs/validation.log",
    benchmark:
        f"{RESULTS}/benchmarks/validation.tsv"
    message:
        "gather the validation cases"
    script:
        "../scripts/gather.py"
