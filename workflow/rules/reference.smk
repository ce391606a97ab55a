# The reference that angles are judged by, comparison with it, and a spot check of the campaign; not
# part of it.


rule reference_pair:
    input:
        unpack(coarser_cells),
    output:
        row=ensure(
            f"{RESULTS}/reference/pairs/{{outcome}}--{{numerics}}.outcome.parquet",
            non_empty=True,
        ),
        cells=f"{RESULTS}/reference/pairs/{{outcome}}--{{numerics}}.cells.npz",
    params:
        settings=reference_settings,
        partial=f"{RESULTS}/reference/partial/{{numerics}}",
    log:
        f"{RESULTS}/logs/reference_pair/{{outcome}}--{{numerics}}.log",
    benchmark:
        f"{RESULTS}/benchmarks/reference_pair/{{outcome}}--{{numerics}}.tsv"
    message:
        "{wildcards.outcome} at the {wildcards.numerics} numerics"
    script:
        "../scripts/study_outcome.py"


rule critical_gap_point:
    input:
        unpack(points_before),
    output:
        table=ensure(f"{RESULTS}/reference/searches/{{search}}--{{number}}.parquet", non_empty=True),
    params:
        settings=search_settings,
        partial=f"{RESULTS}/reference/partial/{{search}}",
    log:
        f"{RESULTS}/logs/critical_gap_point/{{search}}--{{number}}.log",
    benchmark:
        f"{RESULTS}/benchmarks/critical_gap_point/{{search}}--{{number}}.tsv"
    message:
        "critical gap {wildcards.search}, point {wildcards.number}"
    script:
        "../scripts/critical_gap_point.py"


rule critical_gaps:
    input:
        [last_point(search) for search in SEARCHES],
    output:
        gaps=f"{RESULTS}/reference/critical_gaps.parquet",
        gaps_csv=f"{RESULTS}/reference/critical_gaps.csv",
        convergence=f"{RESULTS}/reference/convergence.parquet",
        convergence_csv=f"{RESULTS}/reference/convergence.csv",
    params:
        searches=SEARCHES,
        settings=gathered(
            SEARCHES, "reference", "cell", "flow", "numerics", "run_control", "stiffness_sets"
        ),
    log:
        f"{RESULTS}/logs/critical_gaps.log",
    benchmark:
        f"{RESULTS}/benchmarks/critical_gaps.tsv"
    message:
        "gather the critical gaps and their convergence"
    script:
        "../scripts/critical_gaps.py"


rule reference_outcomes:
    input:
        [pair_row(*pair) for pair in PAIRS],
    output:
        outcomes=f"{RESULTS}/reference/reference_outcomes.parquet",
        outcomes_csv=f"{RESULTS}/reference/reference_outcomes.csv",
        campaign=f"{RESULTS}/reference/campaign_outcomes.parquet",
        campaign_csv=f"{RESULTS}/reference/campaign_outcomes.csv",
        domain=f"{RESULTS}/reference/domain_outcomes.parquet",
        domain_csv=f"{RESULTS}/reference/domain_outcomes.csv",
        model=f"{RESULTS}/reference/sigma_num.json",
        check=f"{RESULTS}/reference/sigma_num_check.parquet",
        check_csv=f"{RESULTS}/reference/sigma_num_check.csv",
    params:
        pairs=PAIRS,
        settings=gathered(PAIRS),
    log:
        f"{RESULTS}/logs/reference_outcomes.log",
    benchmark:
        f"{RESULTS}/benchmarks/reference_outcomes.tsv"
    message:
        "gather the pairs of the reference and model the numerical uncertainty"
    script:
        "../scripts/reference_outcomes.py"


rule reference:
    input:
        rules.reference_outcomes.output,
        rules.critical_gaps.output,
    message:
        "the reference is complete; `make reference` puts it into the package"


rule reference_check:
    input:
        rows=[pair_row(outcome, "campaign") for outcome in CONFIG.reference.pairs],
    output:
        table=f"{RESULTS}/reference_check.parquet",
        csv=f"{RESULTS}/reference_check.csv",
    params:
        settings=reference_check_settings,
    log:
        f"{RESULTS}/logs/reference_check.log",
    benchmark:
        f"{RESULTS}/benchmarks/reference_check.tsv"
    message:
        "compare the campaign's numerics with the reference of the package"
    script:
        "../scripts/reference_check.py"


rule spot_check_plan:
    input:
        outcomes=f"{RESULTS}/outcomes.parquet",
    output:
        f"{RESULTS}/spot_check/cost.txt",
    params:
        drawn=SPOT_CHECKED,
        releases=spot_check_releases,
    log:
        f"{RESULTS}/logs/spot_check_plan.log",
    message:
        "draw the outcomes of the spot check"
    script:
        "../scripts/spot_check_plan.py"


rule spot_check_release:
    input:
        rules.spot_check_plan.output,
    output:
        row=ensure(f"{RESULTS}/spot_check/{{outcome}}.release.parquet", non_empty=True),
        cells=f"{RESULTS}/spot_check/{{outcome}}.cells.npz",
    params:
        settings=spot_check_release_settings,
        partial=f"{RESULTS}/spot_check/partial/release",
    log:
        f"{RESULTS}/logs/spot_check_release/{{outcome}}.log",
    benchmark:
        f"{RESULTS}/benchmarks/spot_check_release/{{outcome}}.tsv"
    message:
        "other releases of {wildcards.outcome}"
    script:
        "../scripts/study_outcome.py"


rule spot_check_run:
    input:
        coarser=rules.spot_check_release.output.cells,
    output:
        row=ensure(f"{RESULTS}/spot_check/{{outcome}}.outcome.parquet", non_empty=True),
    params:
        settings=spot_check_settings,
        partial=f"{RESULTS}/spot_check/partial/run",
    log:
        f"{RESULTS}/logs/spot_check_run/{{outcome}}.log",
    benchmark:
        f"{RESULTS}/benchmarks/spot_check_run/{{outcome}}.tsv"
    message:
        "spot check of {wildcards.outcome}"
    script:
        "../scripts/study_outcome.py"


rule spot_check:
    input:
        outcomes=f"{RESULTS}/outcomes.parquet",
        checks=expand(f"{RESULTS}/spot_check/{{outcome}}.outcome.parquet", outcome=SPOT_CHECKED),
    output:
        table=f"{RESULTS}/spot_check.parquet",
        csv=f"{RESULTS}/spot_check.csv",
    params:
        settings=gathered(SPOT_CHECKED),
    log:
        f"{RESULTS}/logs/spot_check.log",
    benchmark:
        f"{RESULTS}/benchmarks/spot_check.tsv"
    message:
        "compare the spot check with the campaign"
    script:
        "../scripts/spot_check.py"
