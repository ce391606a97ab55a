# Outcomes that fill the space of arrays, cells and flows, to learn from; not part of the campaign,
# see docs/survey.md. How many points a round has is known before, where they lie is not.


rule survey_plan:
    input:
        survey_before,
    output:
        table=ensure(f"{RESULTS}/survey/plans/{{round}}.parquet", non_empty=True),
    params:
        settings=survey_plan_settings,
    log:
        f"{RESULTS}/logs/survey_plan/{{round}}.log",
    benchmark:
        f"{RESULTS}/benchmarks/survey_plan/{{round}}.tsv"
    message:
        "survey: choose the points of round {wildcards.round}"
    script:
        "../scripts/survey_plan.py"


# Releases are kept in the folder `releases`, which is no output: a plan that is made anew with the
# same points costs no simulation.
rule survey_point:
    input:
        plan=plan_of_point,
    output:
        outcome=ensure(f"{RESULTS}/survey/points/{{number}}.outcome.parquet", non_empty=True),
        runs=ensure(f"{RESULTS}/survey/points/{{number}}.runs.parquet", non_empty=True),
        trajectory=ensure(f"{RESULTS}/survey/points/{{number}}.trajectory.parquet", non_empty=True),
        flow=ensure(f"{RESULTS}/survey/points/{{number}}.flow.parquet", non_empty=True),
    params:
        settings=survey_point_settings,
        releases=f"{RESULTS}/survey/releases",
        crashes=survey_crash_count,
        crash_directory=SURVEY_CRASHES,
    log:
        f"{RESULTS}/logs/survey_point/{{number}}.log",
    benchmark:
        f"{RESULTS}/benchmarks/survey_point/{{number}}.tsv"
    message:
        f"survey: point {{wildcards.number}} of {len(SURVEY)}"
    script:
        "../scripts/survey_point.py"


rule survey:
    input:
        plan=expand(
            f"{RESULTS}/survey/plans/{{round}}.parquet", round=range(CONFIG.survey.rounds + 1)
        ),
        outcomes=expand(f"{RESULTS}/survey/points/{{number}}.outcome.parquet", number=SURVEY_POINTS),
        runs=expand(f"{RESULTS}/survey/points/{{number}}.runs.parquet", number=SURVEY_POINTS),
        flows=expand(f"{RESULTS}/survey/points/{{number}}.flow.parquet", number=SURVEY_POINTS),
    output:
        plan=f"{RESULTS}/survey/plan.parquet",
        plan_csv=f"{RESULTS}/survey/plan.csv",
        outcomes=f"{RESULTS}/survey/outcomes.parquet",
        outcomes_csv=f"{RESULTS}/survey/outcomes.csv",
        runs=f"{RESULTS}/survey/runs.parquet",
        runs_csv=f"{RESULTS}/survey/runs.csv",
        flows=f"{RESULTS}/survey/flows.parquet",
        flows_csv=f"{RESULTS}/survey/flows.csv",
    params:
        settings={**gathered(SURVEY), "sigma_num_model": uncertainty.models_hash()},
    log:
        f"{RESULTS}/logs/survey.log",
    benchmark:
        f"{RESULTS}/benchmarks/survey.tsv"
    message:
        "gather the survey, join the numerical uncertainty"
    script:
        "../scripts/survey.py"
