"""Recordings: bags and tables are read, resampled and filtered into joint motions.

Public: `open_recording` and `Recording` (recording), `load_drives`, `direct_drives`, `write_drives` and `Drives`
(drives), `Motion` (joint_motions), `SampleStatistics` (sample_statistics).

Data flow: `bags` or `tables` yield joint samples; `alignment` resamples them to segments on a uniform grid;
`joint_motions` filters the segments and converts them from motors to joints by `drives`.
"""
