# Passages through assays, a job for each assay, cell and membrane, and the calibrations from them.


rule assay_point:
    output:
        rows=ensure(f"{RESULTS}/assays/{{point}}.runs.parquet", non_empty=True),
        trajectory=ensure(f"{RESULTS}/assays/{{point}}.trajectory.parquet", non_empty=True),
    params:
        settings=point_settings,
        crashes=crash_count,
        crash_directory=CRASHES,
    log:
        f"{RESULTS}/logs/assay_point/{{point}}.log",
    benchmark:
        f"{RESULTS}/benchmarks/assay_point/{{point}}.tsv"
    message:
        "passages of {wildcards.point}"
    script:
        "../scripts/assay_point.py"


rule assays:
    input:
        rows_of(POINTS),
    output:
        table=f"{RESULTS}/assay_runs.parquet",
        csv=f"{RESULTS}/assay_runs.csv",
    params:
        kind="assay_runs",
        settings=gathered(POINTS),
    log:
        f"{RESULTS}/logs/assays.log",
    benchmark:
        f"{RESULTS}/benchmarks/assays.tsv"
    message:
        "gather the passages of all assays"
    script:
        "../scripts/gather.py"


rule calibration:
    input:
        rules.assays.output.table,
    output:
        calibration=f"{RESULTS}/calibration.parquet",
        calibration_csv=f"{RESULTS}/calibration.csv",
        correlations=f"{RESULTS}/calibration_correlations.parquet",
        correlations_csv=f"{RESULTS}/calibration_correlations.csv",
    params:
        settings=calibration_settings(),
    log:
        f"{RESULTS}/logs/calibration.log",
    benchmark:
        f"{RESULTS}/benchmarks/calibration.tsv"
    message:
        "calibrate the index of each assay"
    script:
        "../scripts/calibration.py"


rule calibration_library:
    input:
        rows_of(LIBRARY),
    output:
        table=f"{RESULTS}/calibration_library.parquet",
        csv=f"{RESULTS}/calibration_library.csv",
    params:
        kind="calibration_library",
        settings=calibration_settings(LIBRARY),
    log:
        f"{RESULTS}/logs/calibration_library.log",
    benchmark:
        f"{RESULTS}/benchmarks/calibration_library.tsv"
    message:
        "calibrate assays for other cells"
    script:
        "../scripts/assay_curves.py"


rule assay_study:
    input:
        rows_of(STUDIED),
    output:
        table=f"{RESULTS}/assay_study.parquet",
        csv=f"{RESULTS}/assay_study.csv",
        figure=f"{RESULTS}/assay_study.png",
    params:
        kind="assay_study",
        settings=calibration_settings(STUDIED),
    log:
        f"{RESULTS}/logs/assay_study.log",
    benchmark:
        f"{RESULTS}/benchmarks/assay_study.tsv"
    message:
        "compare what assays resolve"
    script:
        "../scripts/assay_curves.py"
