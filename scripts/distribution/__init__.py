"""What leaves the checkout: releases, the offline bundle, the site of the documents."""
