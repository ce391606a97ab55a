# Surrogate of the migration angle, the geometries that separate two cell types best, and their
# verification by simulation.


rule surrogate:
    input:
        rules.outcomes.output.table,
    output:
        model=f"{RESULTS}/surrogate.json",
        card=f"{RESULTS}/surrogate_card.json",
    params:
        settings=learning_settings,
    log:
        f"{RESULTS}/logs/surrogate.log",
    benchmark:
        f"{RESULTS}/benchmarks/surrogate.tsv"
    priority: 1
    message:
        "fit the surrogate of the migration angle"
    script:
        "../scripts/surrogate.py"


DESIGN_INPUTS = {
    "model": rules.surrogate.output.model,
    "card": rules.surrogate.output.card,
    "calibration": rules.calibration.output.calibration,
    "flows": rules.flows.output.table,
    "library": made(rules.calibration_library.output.table),
}


rule designs:
    input:
        **DESIGN_INPUTS,
        outcomes=rules.outcomes.output.table,
    output:
        populations=f"{RESULTS}/design_populations.parquet",
        populations_csv=f"{RESULTS}/design_populations.csv",
        table=f"{RESULTS}/designs.parquet",
        csv=f"{RESULTS}/designs.csv",
        trials=f"{RESULTS}/design_trials.parquet",
        trials_csv=f"{RESULTS}/design_trials.csv",
        tolerances=f"{RESULTS}/design_tolerances.parquet",
        tolerances_csv=f"{RESULTS}/design_tolerances.csv",
        importance=f"{RESULTS}/design_importance.parquet",
        importance_csv=f"{RESULTS}/design_importance.csv",
        slices=f"{RESULTS}/design_slices.parquet",
        slices_csv=f"{RESULTS}/design_slices.csv",
        requests=f"{RESULTS}/design_requests.parquet",
        requests_csv=f"{RESULTS}/design_requests.csv",
    params:
        settings=candidate_settings,
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
        **DESIGN_INPUTS,
    output:
        table=f"{RESULTS}/search_regret.parquet",
        csv=f"{RESULTS}/search_regret.csv",
    params:
        settings=design_settings(CONFIG.design_requests),
    log:
        f"{RESULTS}/logs/search_regret.log",
    benchmark:
        f"{RESULTS}/benchmarks/search_regret.tsv"
    message:
        "compare the design search with random and exhaustive search"
    script:
        "../scripts/search_regret.py"


# Finished releases and outcomes stay in the folder `work`, which is no output: they are used again after a stop.
rule verify:
    input:
        **DESIGN_INPUTS,
        outcomes=rules.outcomes.output.table,
    output:
        verifications=f"{RESULTS}/verify/{{request}}.verifications.parquet",
        designs=f"{RESULTS}/verify/{{request}}.verified_designs.parquet",
        added=f"{RESULTS}/verify/{{request}}.outcomes.parquet",
        requests=f"{RESULTS}/verify/{{request}}.verified_requests.parquet",
        files=directory(f"{RESULTS}/designs/{{request}}"),
    params:
        settings=verification_settings,
        work=f"{RESULTS}/verify/{{request}}",
    log:
        f"{RESULTS}/logs/verify/{{request}}.log",
    benchmark:
        f"{RESULTS}/benchmarks/verify/{{request}}.tsv"
    threads: 2  # both cell types of an array at a time
    priority: 1
    message:
        "verify the designs of {wildcards.request} by simulation"
    script:
        "../scripts/verify.py"


rule verifications:
    input:
        verifications=expand(
            f"{RESULTS}/verify/{{request}}.verifications.parquet", request=REQUESTS
        ),
        designs=expand(f"{RESULTS}/verify/{{request}}.verified_designs.parquet", request=REQUESTS),
        added=expand(f"{RESULTS}/verify/{{request}}.outcomes.parquet", request=REQUESTS),
        requests=expand(f"{RESULTS}/verify/{{request}}.verified_requests.parquet", request=REQUESTS),
        files=expand(f"{RESULTS}/designs/{{request}}", request=REQUESTS),
        outcomes=rules.outcomes.output.table,
    output:
        verifications=f"{RESULTS}/verifications.parquet",
        verifications_csv=f"{RESULTS}/verifications.csv",
        designs=f"{RESULTS}/verified_designs.parquet",
        designs_csv=f"{RESULTS}/verified_designs.csv",
        requests=f"{RESULTS}/verified_requests.parquet",
        requests_csv=f"{RESULTS}/verified_requests.csv",
        outcomes=f"{RESULTS}/outcomes_verified.parquet",
        outcomes_csv=f"{RESULTS}/outcomes_verified.csv",
        model=f"{RESULTS}/surrogate_verified.json",
        card=f"{RESULTS}/surrogate_verified_card.json",
    params:
        settings=verified_settings,
    log:
        f"{RESULTS}/logs/verifications.log",
    benchmark:
        f"{RESULTS}/benchmarks/verifications.tsv"
    message:
        "gather the verified designs and refit the surrogate"
    script:
        "../scripts/verifications.py"
