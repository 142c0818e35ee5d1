"""Mean and spread of both strains over the steps, from all steps as one dataset: pipelines/quickstart.yaml"""

import matplotlib.pyplot as plt

import dicflow

pipeline = dicflow.Pipeline.load("pipelines/quickstart.yaml", data="data_samples", store="build/gallery")
total = pipeline.run(scheduler="threads").dataset("total", chunks="auto")
figure, axes = plt.subplots(figsize=(5, 3.5), layout="constrained")
for name in ("exx", "eyy"):
    mean, spread = (getattr(total[name], what)(("row", "col")).compute() for what in ("mean", "std"))
    axes.errorbar(total.step, mean, yerr=spread, marker="o", capsize=3, label=name)
axes.set(xlabel="step", ylabel="engineering strain")
axes.legend()
