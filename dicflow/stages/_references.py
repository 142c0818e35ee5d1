"""The literature that the sentences of stages cite.

A stage's module may have a function ``sentence(stage, product)``: what the stage does, in a few sentences of a methods
paragraph, in the past tense. ``product`` is its last one, None if the store lacks it. Keys of references stand in
square brackets, ``[baker2004, pan2013]``; a module of another package gives its own as a mapping ``REFERENCES``.
"""

from __future__ import annotations

__all__ = ["REFERENCES"]

REFERENCES = {
    "akaze2013": "P. F. Alcantarilla, J. Nuevo and A. Bartoli, Fast explicit diffusion for accelerated features in "
    "nonlinear scale spaces, British Machine Vision Conference (2013)",
    "baker2004": "S. Baker and I. Matthews, Lucas-Kanade 20 years on: a unifying framework, International Journal of "
    "Computer Vision 56 (2004) 221–255",
    "brisk2011": "S. Leutenegger, M. Chli and R. Y. Siegwart, BRISK: binary robust invariant scalable keypoints, "
    "International Conference on Computer Vision (2011) 2548–2555",
    "brown1971": "D. C. Brown, Close-range camera calibration, Photogrammetric Engineering 37 (1971) 855–866",
    "cleveland1979": "W. S. Cleveland, Robust locally weighted regression and smoothing scatterplots, Journal of the "
    "American Statistical Association 74 (1979) 829–836",
    "duda2018": "A. Duda and U. Frese, Accurate detection and localization of checkerboard corners for calibration, "
    "British Machine Vision Conference (2018)",
    "fusiello2000": "A. Fusiello, E. Trucco and A. Verri, A compact algorithm for rectification of stereo pairs, "
    "Machine Vision and Applications 12 (2000) 16–22",
    "garrido2014": "S. Garrido-Jurado, R. Muñoz-Salinas, F. J. Madrid-Cuevas and M. J. Marín-Jiménez, Automatic "
    "generation and detection of highly reliable fiducial markers under occlusion, Pattern Recognition 47 (2014) "
    "2280–2292",
    "hartley1997": "R. I. Hartley and P. Sturm, Triangulation, Computer Vision and Image Understanding 68 (1997) "
    "146–157",
    "hartley2004": "R. Hartley and A. Zisserman, Multiple View Geometry in Computer Vision, 2nd edition, Cambridge "
    "University Press (2004)",
    "hill1968": "R. Hill, On constitutive inequalities for simple materials — I, Journal of the Mechanics and Physics "
    "of Solids 16 (1968) 229–242",
    "hirschmuller2008": "H. Hirschmüller, Stereo processing by semiglobal matching and mutual information, IEEE "
    "Transactions on Pattern Analysis and Machine Intelligence 30 (2008) 328–341",
    "holland1977": "P. W. Holland and R. E. Welsch, Robust regression using iteratively reweighted least-squares, "
    "Communications in Statistics – Theory and Methods 6 (1977) 813–827",
    "huber1981": "P. J. Huber, Robust Statistics, Wiley (1981)",
    "hurvich1989": "C. M. Hurvich and C.-L. Tsai, Regression and time series model selection in small samples, "
    "Biometrika 76 (1989) 297–307",
    "idics2018": "E. M. C. Jones and M. A. Iadicola (eds.), A Good Practices Guide for Digital Image Correlation, "
    "International Digital Image Correlation Society (2018)",
    "kabsch1976": "W. Kabsch, A solution for the best rotation to relate two sets of vectors, Acta Crystallographica "
    "A32 (1976) 922–923",
    "kaze2012": "P. F. Alcantarilla, A. Bartoli and A. J. Davison, KAZE features, European Conference on Computer "
    "Vision (2012) 214–227",
    "lowe2004": "D. G. Lowe, Distinctive image features from scale-invariant keypoints, International Journal of "
    "Computer Vision 60 (2004) 91–110",
    "lucas1981": "B. D. Lucas and T. Kanade, An iterative image registration technique with an application to stereo "
    "vision, International Joint Conference on Artificial Intelligence (1981) 674–679",
    "mackay1992": "D. J. C. MacKay, Bayesian interpolation, Neural Computation 4 (1992) 415–447",
    "ogden2004": "R. W. Ogden, G. Saccomandi and I. Sgura, Fitting hyperelastic models to experimental data, "
    "Computational Mechanics 34 (2004) 484–502",
    "orb2011": "E. Rublee, V. Rabaud, K. Konolige and G. Bradski, ORB: an efficient alternative to SIFT or SURF, "
    "International Conference on Computer Vision (2011) 2564–2571",
    "pan2008": "B. Pan, H. Xie, Z. Wang, K. Qian and Z. Wang, Study on subset size selection in digital image "
    "correlation for speckle patterns, Optics Express 16 (2008) 7037–7048",
    "pan2013": "B. Pan, K. Li and W. Tong, Fast, robust and accurate digital image correlation calculation without "
    "redundant computations, Experimental Mechanics 53 (2013) 1277–1289",
    "pierron2012": "F. Pierron and M. Grédiac, The Virtual Fields Method: Extracting Constitutive Mechanical "
    "Parameters from Full-field Deformation Measurements, Springer (2012)",
    "savitzky1964": "A. Savitzky and M. J. E. Golay, Smoothing and differentiation of data by simplified least squares "
    "procedures, Analytical Chemistry 36 (1964) 1627–1639",
    "seth1961": "B. R. Seth, Generalized strain measure with applications to physical problems, MRC Technical Summary "
    "Report 248, University of Wisconsin (1961)",
    "torr2000": "P. H. S. Torr and A. Zisserman, MLESAC: a new robust estimator with application to estimating image "
    "geometry, Computer Vision and Image Understanding 78 (2000) 138–156",
    "triggs2000": "B. Triggs, P. F. McLauchlan, R. I. Hartley and A. W. Fitzgibbon, Bundle adjustment – a modern "
    "synthesis, in: Vision Algorithms: Theory and Practice, Springer (2000) 298–372",
    "unser1999": "M. Unser, Splines: a perfect fit for signal and image processing, IEEE Signal Processing Magazine "
    "16(6) (1999) 22–38",
    "zhang2000": "Z. Zhang, A flexible new technique for camera calibration, IEEE Transactions on Pattern Analysis and "
    "Machine Intelligence 22 (2000) 1330–1334",
}
