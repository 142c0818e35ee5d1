"""A sweep: noise of a strain over the window that it is taken from: pipelines/one_camera.yaml"""

import matplotlib.pyplot as plt

import dicflow

windows = [20, 30, 40, 60, 90]
settings = ["total.window=" + ",".join(f"{side} px" for side in windows)]
pipeline = dicflow.Pipeline.load(
    "pipelines/one_camera.yaml", data="data_samples", store="build/gallery", settings=settings
)
result = pipeline.run(scheduler="threads")
sigma = [float(result.dataset("total", 0, variant=k).sigma_eyy.median()) for k in range(len(windows))]
figure, axes = plt.subplots(figsize=(5, 3.5), layout="constrained")
axes.loglog(windows, sigma, marker="o")
axes.set(xlabel="window [px]", ylabel="median σ of εyy")
