"""Every tolerance behind a scientific claim of the tests: value, unit, reason.

A tolerance is a statement about a method's error. It is never widened to make a test pass.
"""

from __future__ import annotations

# --- Strain and conformability ---------------------------------------------------------
LINEAR_ALGEBRA = 1e-12
"""Fraction: closed forms in double precision on numbers of order 1 to 10."""

FIRST_ORDER_SD = 0.02
"""Fraction of an sd, and difference of correlations: what second-order terms add at 0.25 mm
on 15 mm cells, (sd / cell)^2 = 3e-4 times small factors, plus three sampling errors of the
200 000 draws (0.2 %) on quantities whose curvature the shear enlarges tenfold."""

FIELLER_COVERAGE = 0.0065
"""Fraction: four sampling errors of a 95 % coverage counted in 20 000 draws."""

CLIPPED_AREA_MM2 = 1e-9
"""mm^2: double precision on areas of a few hundred mm^2, with nearly parallel sides."""

NOISE_BIAS = 0.001
"""Fraction: the published readings have three digits (half a unit), plus three sampling
errors of a mean over 4000 draws with sd .01 (.0005)."""

INTERVAL_COVERAGE = 0.93
"""Fraction: the intervals are to hold the truth in 95 % of repeated readings; a share counted
in 300 to 400 repeats has a sampling error of .012. A study of ten misfits by the paper's
definition under noise of .1, .25 and .5 mm, 400 repeats each, found .938 to 1 (1 where the
truth is at its limit)."""

RATIO_COVERAGE = 0.90
"""Fraction: the same for the satisfactory ratio of a patch, a count that moves in steps: aimed
at 95 %, found 100 % in 60 repeats at each noise; 100 repeats have a sampling error of .022."""

# --- subject folders ---

NODE_TEXT_MM = 5e-7
"""mm: the tests' nodes tables are written with six decimals."""

# --- report ---

REPORT_LIGHTNESS_STEP = 8.0
"""CIE L*: neighbouring grades and steps of a colour scale must differ by more than this, a
clearly visible step in greyscale; the two halves of a diverging scale by less."""

HARMLESS_STRETCH = 2e-6
"""Fraction: float32 coordinates (PLY, STL, GLB) of 150 mm err by 8e-6 mm on edges of 15 mm."""

HARMLESS_OVERLAP = 2e-6
"""Fraction: the same coordinates, faces in another order: rounding only."""

ROUNDED_OVERLAP = 0.002
"""Fraction: what an overlap claims. A cell of the tests' coarse limb (5 mm faces on curvatures
1/57 and 1/177 per mm) has 9 vertices of .0025 rad angle defect each; on which side of them the
lines from its centre pass, rounding decides (observed up to .0016)."""

PICTURE_DEPTH = 3.0
"""Multiple of h^2 / 2R by which the mean of the vertices of a cube of edge h may lie inside a
cylinder of radius R: the diagonal of the cube's face squared is 2 h^2, plus the border."""

DETOUR_ANGLE_DEG = 1e-6
"""degrees: angles of a few faces summed in double precision; the path's points are 1e-12 exact."""

# --- synthetic truth ---

ROUNDING = 1e-12
"""Relative to 1: double precision after a few dozen operations on numbers of order 1."""

DIFFERENCE_QUOTIENT = 2e-6
"""Central differences with a step of 1e-4 on functions of order 1 to 100: truncation h^2 / 6
times third derivatives (1e-8), rounding 1e-16 / h (tangents 1e-10) or 1e-16 / h^2 (second
derivatives 1e-8 times the values)."""

GEODESIC_BVP_MM = 1e-9
"""mm: the true geodesics' lengths; the promise is 1e-8 mm."""

MESH_ORDER = 0.25
"""Fitted order of a mesh's geodesic distance against the smooth one over two halvings: 2 but
for the terms of the next order on edges of 2.7 mm over a bump of 15 mm."""

TRUE_OVERLAP = 5e-5
"""Fraction: the accuracy that the truth tables state; sides of 24 straight pieces in the
parameter domain leave 1 / 24^2 of a side's bow, which is below 0.3 mm."""

COUNTED_OVERLAP = 2e-4
"""Fraction: points 0.04 mm apart on cells of 15 mm: 3000 points along the sides decide, each
right to a third of its 0.0016 mm^2, in random sense: 3e-5; five of these, plus the sides."""

# --- geodesics and locating ---

GEODESIC_MM = 1e-9
"""mm: the exact distance on a mesh, by two programs in double precision, up to a few hundred mm
(rounding grows with the number of faces crossed; observed below 1e-12)."""

GEODESIC_TABLED_MM = 1e-6
"""mm: pairs.csv was computed before the OBJ coordinates were rounded to six decimals (5e-7 an
end, twice)."""

ANNY_EDGE_MM = 2e-5
"""mm: anny_knee tables are written with five decimals (5e-6) for OBJ coordinates rounded to
four (5e-5 a vertex, partly cancelling along one edge of the grid)."""

HEDGEHOG_PUBLISHED = 5e-6
"""Units of the hedgehog mesh: its published distance has five decimals."""

LOCATE_MM = 1e-11
"""mm: closest points in double precision for coordinates up to about 1000 mm."""

# Gaussian processes (surrogate)
GP_ALGEBRA = 1e-8
"""Targets' unit, same model by two algebras: condition number 1e5 times rounding, and margin."""
GP_CLOSED_FORM = 1e-8
"""Targets' unit, folds left out in closed form against refits at fixed hyperparameters."""
GP_GRADIENT = 1e-5
"""Relative, analytic slope against a central difference of step 1e-5."""
GP_OPTIMUM_LOG_LIKELIHOOD = 0.05
"""Nats, two optimisers at one maximum: each stops when a step gains less than this."""
SVGP_BOUND = 1e-6
"""Nats a row, our collapsed bound against GPyTorch's VariationalELBO: two jitters of 1e-8."""
SPLINE_RESAMPLING = 2e-4
"""Poisson's ratio, rms of the stand-in's curves (12 strains) through the common strain grid."""

CELL_STRAIN = 1.5e-6
"""Fraction: edges tabulated to 1e-5 mm on 15 mm (7e-7 a ratio) and strains to 1e-6 (half)."""

MMP_MM = 1e-6
"""mm, and as a fraction of a 15 mm edge's strain: two exact solvers agree to 1e-9 mm; what the
project promises for the body model's cells."""

ANNY_EDGE_MM = 1.8e-4
"""mm: the OBJ files round vertices to 1e-4 mm, their table came before the rounding: two ends
off by sqrt(3) x 5e-5 mm each, at most."""

ANNY_STRAIN_FROM_TABLE = 2.4e-5
"""Fraction: the same rounding in both poses of a 15 mm edge, at most."""

DUODIC_STRAIN = 0.002
"""Fraction: average over a straight grid inside the strip against the area-weighted average of
all triangles; strains vary by sd .009 over the strip and the grid leaves its rim out."""

NOISE_FLOOR_SD = 2.0e-4
"""Fraction: strain of a rigid cylinder over 15 mm; 1.5e-4 was found with vertices as nodes,
and the sampling error of an sd over some 40 cells is a tenth."""

SCAN_FILE_MM = 5.1e-4
"""mm: scans are written with three decimals."""

NODE_FILE_MM = 5.1e-5
"""mm: nodes are written with four decimals."""

OVERLAP = 0.002
"""Fraction: what the project promises on spheres of radius 25 to 60 mm, on cylinders and on the
synthetic knees, with 15 mm cells; the largest error found is .0004 on 0.8 mm triangles of
spheres and cylinders, .0018 on the recorded knees, whose triangles are 2.2 mm and longer."""

SECOND_METHOD = 0.001
"""Fraction: flattening against clipping on the same mesh. Half of what is promised; the largest
difference found is .0005, from the curvature varying within a cell."""

PRINTED_OVERLAP = 1e-8
"""Fraction: tables have nine significant digits."""

# --- Scans: denoising and registration -------------------------------------------------------

DENOISED_LENGTHENING_0_05_MM = 6e-4
"""Share by which 15 mm paths may still be too long after denoising 0.05 mm of noise at 0.31 mm
edges: the figure of an earlier prototype. Measured here: 3e-5."""

DENOISED_LENGTHENING_0_1_MM = 2.3e-3
"""The same for 0.1 mm of noise. Measured here: 1.1e-4."""

DENOISED_CLEAN_CHANGE = 2e-4
"""Share by which denoising may change 15 mm paths on a clean surface: a fifth of the
lengthening (1e-3) above which a scan is denoised at all."""

NOISE_SD_RELATIVE = 0.1
"""Estimated against true standard deviation of white noise: the filter keeps the noise's
longest waves, about 1 / (passes + 1) of its variance, 5 % for 20 passes."""

PREDICTED_LENGTHENING_RELATIVE = 0.25
"""Predicted against true mean lengthening: both are means of 40 to 48 paths whose lengthening
spreads by about half of itself; 3 standard errors of the difference are 0.3."""

REGISTRATION_CLEAN_MM = 0.01
"""Largest displacement error without noise: facets of 2 mm on radii of 50 mm lie up to 0.01 mm
inside the surface, differently on two meshes."""

REGISTRATION_SIGMAS = 3.5
"""Displacement error in standard deviations that the covariance predicts, a single direction."""

REGISTRATION_NOISY_MM = 0.15
"""Largest displacement error with 0.1 mm of white noise, also where a patch lies over nearly half
of the common skin and is not masked: half of the 0.3 mm that is known to change grades."""

REGISTRATION_MULTIDIC_MM = 0.015
"""Displacement along normals of a real rigid body against its matched points: the rms residual
of the points themselves after the best rigid motion is 0.013 to 0.014 mm (SOURCE.txt)."""

FRAME_MM = 0.02
"""mm: registration of a bumpy limb of 1.5 mm facets, whose chords stand 0.006 mm off; 0.3 mm
would change grades, 0.02 mm changes an overlap by .0027 at most."""

CURVATURE = 0.03
"""Fraction of 1 / R^2: the series for the curvature ends after its first term."""

FLAT_AREA = 0.002
"""Fraction of a cell's area on a sphere of radius 25 mm or more; .0016 was found, of which
chords of 0.8 mm triangles make .0003. Without the equal-area correction it would be .01."""

# Lattice and finite elements

LATTICE_LENGTH_MM = 1e-9
"""mm. Closed-form gaps and lengths against shapely: rounding of coordinates of 100 mm."""

PATCH_TEST = 1e-10
"""Fraction. A homogeneous state is in the space of every mesh: rounding and the solver's end."""

TANGENT_DIFFERENCE = 1e-7
"""Fraction of the largest entry. Central differences of forces with steps of 1e-6 mm."""

CONDENSED_SOLUTION = 1e-9
"""Fraction. Facet-wise elimination against SuperLU on the whole matrix: conditioning only."""

SOLVED_POISSON = 1e-5
"""Poisson's ratio. Newton's method ends at an energy error of 1e-9 of the stored energy, and
takes that last step: the displacements are then good to 1e-5 of themselves."""

MIRRORED_MESH = 1e-4
"""Fraction. Facet meshes are mirrored in x only, so a whole sheet's mesh is not quite the mirror
image of its quarter's: second order in a mesh error of .006."""

ENERGY_WORK = 2e-5
"""Fraction. Energy against the work of the reaction by Simpson's rule over 40 steps."""

POISSON_MESH = 0.01
"""Poisson's ratio. The mesh error promised for every design at the default meshes."""

POISSON_CALCULIX = 0.005
"""Poisson's ratio (engineering). Mesh of the witness (quads of .25 mm) and K/mu = 100."""

POISSON_CALCULIX_SAME_MESH = 0.002
"""Poisson's ratio (engineering). The same nodes and elements; K/mu = 500, printed digits."""

POISSON_PAPER = 0.02
"""Poisson's ratio (log). The paper prints two digits of an unconverged mesh of 0.5 mm."""

# --- Cross-validation ------------------------------------------------------------------------

CRPS_QUADRATURE = 1e-9
"""Unit of the target: adaptive quadrature to 1e-12 of tails cut at 12 standard deviations."""

CLOSED_FORM_AGAINST_REFIT = 1e-8
"""Targets' unit: leave-fold-out in closed form against a refit at the same hyperparameters; what
the project promises."""

# --- shipped design spaces ---

SHIPPED_ROW = 1e-6
"""Fraction: recomputed stretches and stresses; tables have nine digits, the solver's energy
tolerance of 1e-9 leaves less than 1e-7 in either."""

NU_DIP = 5e-4
"""Poisson's ratio (log): how far it may fall before it rises in (99, 95), where meshes of 3.8, 14
and 53 thousand unknowns agree on a fall of .00025 to .00028."""

# --- snapping sheets ---

SNAP_POISSON = 2e-3
"""Poisson's ratio (log): one load step against fifteen where hinges snap on the way; the energy
may have several minima that differ in a hinge, far below the mesh error of .01."""

# --- worn patch ---

SPLINE_CURVATURE = 0.02
"""Fraction: Gauss curvature of a bicubic spline through nodes of 10 mm on a sphere of 50 mm:
second derivatives err by (h/r)^2 / 12 = .33 % inside and more near the border."""

# --- fabrication ---

STROKE_ROUNDING_MM = 1e-9
"""mm: double precision on coordinates of a few hundred mm."""

FILE_MM = 0.01
"""mm: what a file for the laser may differ from the design in positions, lengths, extents."""

TRAVEL_RATIO = 1.10
"""Ratio of the head's travel to the shortest (proved from below): the requirement."""

WEAR_T6_MM = 0.02
"""mm: corners of 15 mm cells at 30 % strain, nine-node quads (16 divisions a facet edge) against
graded six-node triangles twice as fine as their default: the errors of both, .01 each."""

WEAR_CYLINDER_MM = 1e-3
"""mm: a chord of a nine-node element (1.5 mm) on a radius of 30 mm is short by 1e-4 of itself;
the claim of the docs."""

WEAR_ELEMENTS_MM = 0.005
"""Fraction of the energy: Richardson's extrapolation of first-order four-node quads."""

WEAR_STICK_ENERGY = 1e-5
"""Fraction: nine-node quads of .75 mm follow a sphere of 50 mm to fourth order (3e-6)."""

WEAR_TIP_STRETCH = 3e-4
"""Fraction: quarter-point elements take a quadratic field at their nodes only; in between its
slope, .001 / mm, errs by a part of what it changes over half a millimetre."""

WEAR_TIP_PLACE = 1e-4
"""Stretch: in a field whose stretch grows by .01 / mm it tells the place of a point to .01 mm; a
slanted line of nodes beside a tip adds the square of a shear of .01, found 5e-5."""

REST_STRAIN = 0.1
"""Fraction: largest strain of a sheet of bilinear quads of 1.25 mm against that of the cubic spline
through its sites, which lie 5 mm apart; found .08."""

# --- calibration ---

PARAMETER_ROUNDING = 1e-5
"""Fraction: parameters of a law fitted to its own curve in double precision; two Ogden terms have
a condition number of 1e2 to 1e3 and end at a relative change of 1e-9 or so."""

CURVE_COVERAGE = 0.89
"""Fraction: 95 % intervals of parameters, counted in 60 draws: two sampling errors (.028) below
95 %. A study of 200 draws found .99 to 1 under white noise, .95 to .98 under errors with a
correlation length of .03 to .1 of the range."""

PART_OF_WHITE_NOISE = 0.05
"""Fraction: of the standard deviation of white noise that the mixture over correlated errors may
count as misfit instead; each case keeps some weight, however unlikely."""

# --- tensile ---

TENSILE_SUBSET_PX = 0.01
"""px: the bias of cubic B-splines on a pattern of a few pixels, rounded up."""

TENSILE_STRAIN = 0.002
"""Strain: the requirement on rendered and real frames, for every cell."""

TENSILE_NU = 0.01
"""Poisson's ratio: the requirement, for the mean over the cells of a frame."""

TENSILE_MIXED_STRAIN = 0.008
"""Strain of one speckled cell where the cuts of neighbours differ at random by a third: the
hinges beside a cell's corner, a few pixels wide, no longer cancel; found .0066."""

TENSILE_SLITS_NU = 0.015
"""Poisson's ratio of one cell by its open slits: the middle of a hole is that of its cut only
where the cells around it are alike."""

WEAR_SENSITIVITY = 1e-6
"""Fraction of the largest: the derivatives are exact for the discrete model; differences of
fourth order with steps of 1e-4 of solutions to 1e-10 err by 1e-7."""

WEAR_CALCULIX_STRAIN = 0.005
"""Strain: the bound that was set. CalculiX's CPS8R integrates less and is not quite
incompressible (K = 100 mu)."""

SAME_DISCRETE_MODEL = 1e-6
"""Fraction: one mesh and one law solved along other load steps, each to the solver's tolerance."""

DIAGNOSED_CUT_PERCENT = 0.6
"""Percent of the cell: cut lengths from a pull of eight cells, strains with a noise of 5e-4 and
cells that differ by 1 % for good: the 95 % half-widths are .1 to .5."""

DISTANCE_COVERAGE = 0.89
"""Fraction: 95 % intervals of the distance of two curves, counted in 200 draws of ten cells (a
normal interval for a sum of squares whose covariance is estimated): found .90 to 1."""

ANGLE_DEFECT = 0.03
"""Fraction: Gauss curvature by the angles of chords of 10 mm on a sphere of 60 mm:
(h / r)^2 = .028."""

REST_SPHERE_MM = 1e-6
"""mm: symmetry; Newton's method ends at 1e-10 of the stiffness times the cell."""

# --- design of cuts ---

OPTIMUM = 1e-7
"""Fraction of the cell edge: Newton's method ends at steps below 1e-9, and the functions' own
rounding moves a minimum by its square root, 1e-8."""

BRUTE_STEP = 1e-3
"""Fraction of the cell edge: the step of the brute-force grids; the global optimum can be better
than the best grid point by up to a step, and never worse."""

DIFFERENCE_SLOPE = 1e-6
"""Fraction of the largest derivative: central differences with steps of 1e-4 on functions whose
third derivatives are up to 1e3 err by 2e-6 of them."""

AUTOGRAD = 1e-9
"""Fraction of the largest derivative: closed forms against torch's differentiation; weights of a
nearly noise-free process cancel some six digits."""

ON_TARGET = 1e-8
"""Of Poisson's ratio: points that Newton's method put onto a level curve."""

BALANCED_NU = 2e-3
"""Of Poisson's ratio: what the smoothness terms (neighbour_sd .5) may cost where targets and forces
can be met together: (.01 / .5)^2 of differences of up to .8, times a slope of 1 to 4."""

BALANCED_FORCE = 5e-3
"""Of ln force: the same with force_sd .05."""

BALANCED_SUM = 1e-5
"""Relative: Newton's method ends where a step promises 1e-8 of the sum; least squares of others end
at changes of 1e-8 of theirs, after hundreds of small steps."""

STRAIN_TABLE = 2e-3
"""Fraction of the range: cubic splines with 61 nodes an axis. The stand-in's process is rougher
than those of the shipped tables (1e-4 at most there)."""

# --- designs checked as worn ---

SAME_ROUTE = 2e-3
"""Overlap: a worn scan whose patch is projected along smoothed normals, against the same corners
laid on the bare scan. On facets of 3 mm with mirror lines a side has two shortest paths, past
either flank of a facet, and the two routes may take either (a perfect fit reads down to .998)."""

FAST_OVERLAP = 0.006
"""Overlap: polynomial charts and straight sides against geodesics, for corners up to a tenth of a
cell off. Half a millimetre of either on facets of 3 mm changes a cell of 10 mm by so much; on the
synthetic knees .0034 was found (rms .0007)."""

PLACEMENT_MM = 0.12
"""mm: a limit of placement is interpolated between solves at most .1 mm apart from it."""

# --- contact of worn patches ---

WEAR_PRESSURE = 2e-3
"""Fraction of tension over radius: contact pressure of facets against membrane theory, elements
of 1.5 mm on radii of 40 to 60 mm."""

WEAR_PRESSURE_ISOMETRY = 0.02
"""Fraction of the largest pressure: the same patch on two cylinders; elements of the mesh are
chords of the narrow one."""

WEAR_SLIT = 0.03
"""Fraction: opening of a slit against the infinite sheet: the sheet is ten slits wide, and two
small slits shade it from the corners of the cell; its overlap under as much compression: .2 %."""

CREDIBLE_RATIO = 0.05
"""Share of cells: predicted against worn satisfactory ratio, the bound that was set."""

CREDIBLE_OVERLAP = 0.01
"""Overlap: worn patches solved by other elements or another program (.02 mm, .005 in strain on
cells of 15 mm), and read through a scan with facets of 5 mm on a radius of 60 mm."""
