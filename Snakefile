# A campaign: array flows, cell runs and constriction runs; then statistics, surrogate and designs.
# Targets are the names of the rules without wildcards: snakemake -j2 robustness_map


configfile: f"{workflow.basedir}/config.yaml"


include: "workflow/rules/common.smk"
include: "workflow/rules/simulate.smk"
include: "workflow/rules/calibrate.smk"
include: "workflow/rules/analyse.smk"
include: "workflow/rules/design.smk"
include: "workflow/rules/validate.smk"
include: "workflow/rules/accuracy.smk"
include: "workflow/rules/reference.smk"
include: "workflow/rules/stability.smk"
include: "workflow/rules/survey.smk"
include: "workflow/rules/report.smk"


rule all:
    default_target: True
    input:
        rules.trajectories.output,
        rules.flows.output,
        rules.report.output,
    message:
        "the campaign is complete"


for each in workflow.rules:
    watch(each)


onstart:
    write_stamp(Path(RESULTS))


onerror:
    from dldsim.report.campaign_page import renew_report

    logger.info(renew_report(Path(RESULTS), CONFIG.model_dump(mode="json")))


onsuccess:
    logger.info(campaign.closing_sentence(Path(RESULTS)))
