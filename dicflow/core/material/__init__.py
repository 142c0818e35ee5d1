"""Rubber under load: models of incompressible hyperelastic material, fitted to tests and compared with others.

A **stretch** λ is length per first length. The **nominal stress** P is force per first area, the **true stress**
σ = P λ force per present area, since volume is kept (λ1 λ2 λ3 = 1). Axis 1 is that of the load; the surfaces across
axis 3 are free of stress. The **mode** of a test says how axis 2 deforms: uniaxial (free), planar (held, also called
pure shear), equibiaxial (pulled like axis 1), biaxial (at a stretch that is measured).

A **model** gives the energy W per first volume as a function of the principal stretches and of its **constants**.
With stresses in MPa, energies are in mJ/mm³ and constants in MPa, but for exponents and limits, which are pure
numbers. Throughout, tᵢ = λᵢ ∂W/∂λᵢ, and P = (t1 − t3) / λ1.

A **test** is one specimen's stretches and stresses. Its errors have **independent** shares, new at every point, and
**common** ones, which all points share: the thickness scales every stress. Only independent shares weigh the points.
"""
