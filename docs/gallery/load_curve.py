"""Force over the strain of an extensometer, with twice its uncertainty: pipelines/one_camera.yaml"""

import matplotlib.pyplot as plt

import dicflow

pipeline = dicflow.Pipeline.load("pipelines/one_camera.yaml", data="data_samples", store="build/gallery")
table = pipeline.run(scheduler="threads").to_dataframe("probes")
figure, axes = plt.subplots(figsize=(5, 3.5), layout="constrained")
axes.errorbar(table["strain"], table["force_N"], xerr=2 * table["u_strain"], marker="o", capsize=3)
axes.set(xlabel="strain of the extensometer", ylabel="force [N]")
