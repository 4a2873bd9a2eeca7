"""The pose from landmarks.

In: 2D-3D correspondences. Out: the pose, its inliers and residuals, its covariance, or why they determine none.
"""
