"""The stages of the algorithm, one module each.

Names of parameters that mean the same in all of them; docstrings say what differs. A parameter whose name is that of a
named tuple (peak: Peak, cover: Cover) is one.

    depth_mm         (H, W) uint16, the depth image in millimetres as delivered
    marks            (H, W) uint16 of `classify`
    limits           PixelLimits of `classify`; RampLimits in ramps.py and smeared_edges.py
    info             CameraInfo; k: (4,) its fx, fy, cx, cy; focal_px: its fx
    params, p        Params
    settings         VIEW_SETTINGS (GROUND_SETTINGS in ground.py): (1,) in functions called from Python, else the record;
                     w: a record of WALK_SETTINGS, tuning: of GROUND_SETTINGS
    state            ExtractorState before the frame
    ke_per_m         noise coefficient of depth, sigma_Z = ke Z^2
    R_level_optical  (3, 3) rotation, R in kernels
    view             ViewGeometry of the levelled view, H: its homography, gain: its f_px * lsb_per_px
    codes            (cols, rows) uint16, quantised disparity of the levelled view; line: one column of it
    marked           MarkedView of open_blocks.py, mm: its millimetres and marks; columns: Columns of open_columns.py, or
                     (first, end) of the columns of cells that a function works on; s: a record of OPEN_SETTINGS
    source, image    SOURCE: (1,), and its record
    ground           Ground of the frame; GroundThreshold in the stages of strips
    points           (N,) POINT, sampled pixels of ground.py
    bins             BinTable
    column           Column, the column whose strips are searched
    sampled          Sampled of the direction of the free-range profile that is judged; cell: its ProfileCell in one
                     layer; part: the Part of that at a distance; rings: Rings of the layer
    strips, n        (N,) STRIP of which the first n are used; StripList in the stages of planes
    first_of_column  (cols + 1,) int32: the strips of column u are first_of_column[u]..first_of_column[u + 1] - 1
    kind             kind of a strip, SMOOTH to MERGED
    planes, count    (N,) PLANE of which the first `count` are used
    tables           PlaneTables
    openings         OpeningMasks
    bias             DepthBias of the camera
    buffers, keep    scratch memory, flags of strips
    out              output; StripOutput in the stages of strips"""
