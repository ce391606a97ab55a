# Statistics and regression on the table of outcomes.


rule anova:
    input:
        rules.outcomes.output.table,
    output:
        table=f"{RESULTS}/anova.parquet",
        csv=f"{RESULTS}/anova.csv",
        diagnostics=f"{RESULTS}/anova_diagnostics.parquet",
        diagnostics_csv=f"{RESULTS}/anova_diagnostics.csv",
    params:
        settings=seeded(),
    log:
        f"{RESULTS}/logs/anova.log",
    benchmark:
        f"{RESULTS}/benchmarks/anova.tsv"
    message:
        "analyse the variance of the migration angle"
    script:
        "../scripts/anova.py"


rule robustness_map:
    input:
        rules.outcomes.output.table,
    output:
        table=f"{RESULTS}/robustness.parquet",
        csv=f"{RESULTS}/robustness.csv",
    params:
        settings=settings_of(),
    log:
        f"{RESULTS}/logs/robustness_map.log",
    benchmark:
        f"{RESULTS}/benchmarks/robustness_map.tsv"
    message:
        "score the robustness of each geometry"
    script:
        "../scripts/robustness_map.py"


rule sensitivity:
    input:
        outcomes=rules.outcomes.output.table,
        model=f"{RESULTS}/surrogate.json",
        card=f"{RESULTS}/surrogate_card.json",
    output:
        sobol=f"{RESULTS}/sobol.parquet",
        sobol_csv=f"{RESULTS}/sobol.csv",
        partial_dependence=f"{RESULTS}/partial_dependence.parquet",
        partial_dependence_csv=f"{RESULTS}/partial_dependence.csv",
        fabrication=f"{RESULTS}/fabrication.parquet",
        fabrication_csv=f"{RESULTS}/fabrication.csv",
    params:
        settings=seeded("fabrication"),
    log:
        f"{RESULTS}/logs/sensitivity.log",
    benchmark:
        f"{RESULTS}/benchmarks/sensitivity.tsv"
    message:
        "ask the surrogate for sensitivities and fabrication risks"
    script:
        "../scripts/sensitivity.py"


rule benchmark:
    input:
        rules.outcomes.output.table,
    output:
        table=f"{RESULTS}/benchmark.parquet",
        csv=f"{RESULTS}/benchmark.csv",
        predictions=f"{RESULTS}/predictions.parquet",
        predictions_csv=f"{RESULTS}/predictions.csv",
    params:
        settings=learning_settings,
    log:
        f"{RESULTS}/logs/benchmark.log",
    benchmark:
        f"{RESULTS}/benchmarks/benchmark.tsv"
    message:
        "compare regressors of the migration angle"
    script:
        "../scripts/benchmark.py"


rule learning_curve:
    input:
        rules.outcomes.output.table,
    output:
        table=f"{RESULTS}/learning_curve.parquet",
        csv=f"{RESULTS}/learning_curve.csv",
    params:
        settings=learning_settings,
    log:
        f"{RESULTS}/logs/learning_curve.log",
    benchmark:
        f"{RESULTS}/benchmarks/learning_curve.tsv"
    message:
        "learn the migration angle from fewer outcomes"
    script:
        "../scripts/learning_curve.py"
