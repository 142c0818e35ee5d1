"""Three tests on one rubber that are fitted together: pipelines/rubber_curves.yaml"""

import matplotlib.pyplot as plt

import dicflow

pipeline = dicflow.Pipeline.load("pipelines/rubber_curves.yaml", data="data_samples/rubber", store="build/gallery")
result = pipeline.run(scheduler="threads")
figure, axes = plt.subplots(figsize=(5, 3.5), layout="constrained")
for name in ("uniaxial", "planar", "equibiaxial"):
    curve = result.to_dataframe(name)
    axes.plot(curve["stretch"], curve["nominal_stress_MPa"], marker=".", label=name)
axes.set(xlabel="stretch", ylabel="nominal stress [MPa]")
axes.legend()
