"""Volumes and label maps from files.

In: NIfTI, NRRD, folders of DICOM slices. Out: voxels in Hounsfield units or labels, and where they lie.
"""
