"""Where models come from: catalogues, one file each, behind one small interface (`entry`)."""
