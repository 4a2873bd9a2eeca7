"""In: published data sets, or a random generator. Out: cases, photographs and poses that measurements are made on."""
