"""Strain along the load over the photograph: pipelines/quickstart.yaml"""

import dicflow

pipeline = dicflow.Pipeline.load("pipelines/quickstart.yaml", data="data_samples", store="build/gallery")
result = pipeline.run(scheduler="threads")
figure = dicflow.plot(result, "total", "eyy", step="step_04")
