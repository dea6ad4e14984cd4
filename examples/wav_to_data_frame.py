"""From a recording to a data frame: python examples/wav_to_data_frame.py finger.wav

Needs pandas. Without it, `table.times`, `table.touch` and `table.roughness` are NumPy
arrays.
"""

import sys

import tactophone

if __name__ == "__main__":
    table = tactophone.classify(sys.argv[1], events=True)
    table.to_csv("finger.csv")
    frame = table.to_pandas()
    print(frame[["window_end", "touch", "roughness", "level_dbfs", "amplitude"]])
    print(frame.groupby("touch")["roughness"].mean())
