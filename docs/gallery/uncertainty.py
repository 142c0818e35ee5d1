"""The uncertainty of the same strain: pipelines/quickstart.yaml"""

import dicflow

pipeline = dicflow.Pipeline.load("pipelines/quickstart.yaml", data="data_samples", store="build/gallery")
result = pipeline.run(scheduler="threads")
figure = dicflow.plot(result, "total", "u_eyy", step="step_04")
