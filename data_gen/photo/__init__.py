"""Pictures that look like photographs: soft shadows, light from all around, reflections, film.

Pure numpy, but for the function that sends rays to the mesh, which is passed in. All colours are
in linear light until `develop`. Light is looked for from each pixel along a few rays, of two
kinds: toward the bright parts of the environment map, and spread as the surface reflects light;
their results are weighted by the balance heuristic (Veach 1997). Sixteen patterns of rays take
turns in blocks of 4 x 4 pixels, and a filter that keeps edges averages over such blocks, so that
a pixel has the light of sixteen times as many rays; where nothing is in the way, there is no
noise. What other surfaces send is estimated once for each face, from its colour and the light that
it gets.
"""
