"""Images that look like photographs: soft shadows, environment light, reflections, camera response.

Everything is computed with numpy, except for the intersection of rays with the mesh, which is
passed in as a function. All colours are linear until `develop`.

The irradiance of each pixel is estimated with a few rays of two kinds: toward bright parts of the
environment map, and distributed by the cosine of the angle to the normal. They are combined by the
balance heuristic (Veach 1997). Each of the 16 pixels in a block of 4 x 4 uses a different set of
rays, and an edge-preserving filter averages over such blocks. The result corresponds to sixteen
times as many rays. Unoccluded surfaces have no noise. The light that a face of the model reflects
onto other faces is estimated once, from its colour and its irradiance.
"""
