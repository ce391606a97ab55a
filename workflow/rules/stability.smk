# Scenes driven to extremes beside what is predicted of them; not part of the campaign.


rule stability_family:
    output:
        table=ensure(f"{RESULTS}/stability/{{family}}.parquet", non_empty=True),
    params:
        settings=settings_of("cell", "flow", "numerics", "stiffness_sets", "constriction_groups"),
    log:
        f"{RESULTS}/logs/stability_family/{{family}}.log",
    benchmark:
        f"{RESULTS}/benchmarks/stability_family/{{family}}.tsv"
    message:
        "stability: {wildcards.family}"
    script:
        "../scripts/stability_family.py"


rule stability:
    input:
        expand(f"{RESULTS}/stability/{{family}}.parquet", family=FAMILIES),
    output:
        table=f"{RESULTS}/stability.parquet",
        csv=f"{RESULTS}/stability.csv",
    params:
        kind="stability",
        settings=gathered([*FAMILIES]),
    log:
        f"{RESULTS}/logs/stability.log",
    benchmark:
        f"{RESULTS}/benchmarks/stability.tsv"
    message:
        "gather the stability sweep"
    script:
        "../scripts/gather.py"
